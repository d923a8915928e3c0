"""The steps of `register` with targets and control, one after the other in this process."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.progress import NoProgress
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from schemas.requests.register_inputs import RegisterInputs
from schemas.results.registration_result import RegistrationDocument
from schemas.results.scene import StoredScene
from service.adapters.files.local_files import LocalFiles
from service.formats import writers
from service.names.content_keys import content_key
from service.names.scene_keys import scene_key
from service.ports import Json, StepContext
from service.processes import STEPS
from service.processes.register.plan import RegisterPlan

STD_M = 0.002
SCENE = SCENES["house"]()
POSES = SCENE.stations[:3]
TO_GRID = RigidTransform.from_components([4_512_000.0, 5_402_000.0, 312.0], Rotation.from_euler("z", 0.7))
PLACES = np.array(
    [[0.0, 0.0, 0.5], [9.0, 1.0, 3.0], [2.0, 8.0, 1.0], [11.0, 7.0, 4.0], [5.0, -4.0, 2.0], [-3.0, 4.0, 2.5]]
)
GRID = TO_GRID.apply(PLACES)
NAMES = ("A", "B", "C")


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> StepContext:
    folder = tmp_path_factory.mktemp("tied")
    found = StepContext(
        LocalFiles(folder / "store"),
        NoProgress(),
        {"max_points": 10**6, "max_photo_pixels": 10**6, "min_free_bytes": 0},
    )
    scanner = VirtualScanner(rows=100, columns=240, mixed_pixels=False)
    for name, scan in zip(NAMES, simulate_stations(SCENE, POSES, scanner, np.random.default_rng(1)), strict=True):
        path: Path = folder / f"{name}.e57"
        writers.write_scans(path, [scan])
        found.blobs.put_file(content_key(name * 64), path)
    return found


def targets(number: int) -> list[Json]:
    rng = np.random.default_rng(number)
    places = POSES[number].inv().apply(PLACES) + STD_M * rng.normal(size=PLACES.shape)
    return [{"name": f"P{k}", "x": x, "y": y, "z": z, "std": STD_M} for k, (x, y, z) in enumerate(places.tolist())]


def control(wrong_m: float = 0.0, axes: tuple[int, int, int] = (0, 1, 2)) -> list[Json]:
    values = GRID + STD_M * np.random.default_rng(9).normal(size=GRID.shape)
    values[4, 1] += wrong_m
    values = values[:, list(axes)]
    return [
        {"name": f"P{k}", "x": x, "y": y, "z": z, "std": STD_M, "use": "check" if k == 5 else "control"}
        for k, (x, y, z) in enumerate(values.tolist())
    ]


def registered(context: StepContext, stations: int, wanted: Json | None = None, **said: object) -> RegistrationDocument:
    listed = [
        {"name": name, "scan": {"file": name}, "targets": targets(number)}
        for number, name in enumerate(NAMES[:stations])
    ]
    inputs = RegisterInputs.model_validate_json(
        json.dumps({"stations": listed, "method": {"method": "targets"}, **said})
    ).model_dump(mode="json")
    files = {name: {"name": f"{name}.e57", "sha256": name * 64, "scans": []} for name in NAMES}
    job: Json = {"id": "j", "inputs": inputs, "files": files, "wanted": wanted or {}}
    outputs: list[list[Json]] = []
    while (calls := RegisterPlan().next_stage(job, outputs)) is not None:
        outputs.append([json.loads(json.dumps(STEPS[call.name](context, call.arguments))) for call in calls])
    return RegistrationDocument.model_validate_json(context.blobs.local_path("jobs/j/result.json").read_bytes())


def statistic(document: RegistrationDocument, frame: RigidTransform) -> float:
    """Give the largest eᵀ C⁻¹ e of a station's pose."""
    found = []
    for station, known in zip(document.stations, POSES, strict=False):
        assert station.world_from_scan is not None
        if station.status == "fixed":
            continue
        truth = frame * known
        estimate = RigidTransform.from_matrix(np.array(station.world_from_scan.matrix))
        turn = (estimate.rotation * truth.rotation.inv()).as_rotvec()
        error = np.concatenate([turn, np.asarray(estimate.translation) - np.asarray(truth.translation)])
        found.append(float(error @ np.linalg.solve(np.array(station.world_from_scan.covariance), error)))
    return max(found)


@pytest.mark.slow
@pytest.mark.parametrize("stations", [2, 3])
def test_poses_come_in_the_frame_of_the_control_and_its_wrong_point_is_named(
    context: StepContext, stations: int
) -> None:
    document = registered(context, stations, control=control(wrong_m=0.06))
    assert document.status == "registered"
    assert {station.status for station in document.stations} == {"registered"}
    assert statistic(document, TO_GRID) < 27.9  # chi-square of 6, 0.01 %
    assert document.control is not None
    told = {point.name: point for point in document.control.points}
    assert [name for name, point in told.items() if point.state == "removed"] == ["P4"]
    assert told["P5"].state == "check"
    assert told["P5"].statistic is not None
    assert told["P5"].statistic < 16.3
    assert any("P4" in reason for reason in document.control.reasons)
    page = context.blobs.local_path("jobs/j/artifacts/report.html").read_text(encoding="utf-8")
    assert "P4" in page


@pytest.mark.slow
@pytest.mark.parametrize("fix", ["first", "B", "free"])
def test_other_frames_are_those_of_stations(context: StepContext, fix: str) -> None:
    document = registered(context, 2, control=control(), fix=fix)
    base = 1 if fix == "B" else 0
    assert [station.name for station in document.stations if station.status == "fixed"] == (
        [] if fix == "free" else [NAMES[base]]
    )
    if fix != "free":
        assert statistic(document, POSES[base].inv()) < 27.9


@pytest.mark.slow
def test_a_viewer_shows_targets_and_known_points_where_they_are_in_the_world(context: StepContext) -> None:
    """The world is that of station B, and the targets of both stations lie on the points."""
    result = registered(context, 2, control=control(), fix="B")
    scene = StoredScene.model_validate_json(context.blobs.local_path(scene_key("j")).read_bytes())
    assert result.control is not None
    points = {point.name: point for point in scene.control}
    assert [(each.name, each.state) for each in scene.control] == [
        (each.name, each.state) for each in result.control.points
    ]
    for told in result.control.points:
        shown = points[told.name]
        assert shown.place_m is not None
        assert told.difference_m is not None
        assert np.linalg.norm(np.subtract(shown.place_m, shown.known_m)) == pytest.approx(
            np.linalg.norm(told.difference_m), abs=1e-6
        )
    for station in scene.stations:
        assert [target.name for target in station.targets] == [f"P{k}" for k in range(len(PLACES))]
        pose = RigidTransform.from_matrix(np.array(station.world_from_scan))
        for target in station.targets:
            adjusted = pose.apply(np.add(target.centre_m, target.residual_m))
            np.testing.assert_allclose(adjusted, np.array(points[target.name].place_m), atol=1e-5)


@pytest.mark.slow
def test_three_stations_are_adjusted_with_their_targets_without_control(context: StepContext) -> None:
    document = registered(context, 3)
    assert document.status == "registered"
    assert document.control is not None
    assert document.control.status == "adjusted"
    assert statistic(document, POSES[0].inv()) < 27.9


@pytest.mark.slow
def test_control_that_nobody_sees_leaves_the_poses_and_says_why(context: StepContext) -> None:
    elsewhere = [{**point, "name": f"Q{k}", "x": 3.0 * point["x"]} for k, point in enumerate(control())]
    document = registered(context, 2, control=elsewhere)
    assert document.status == "registered"
    assert document.control is not None
    assert document.control.status == "not-determined"
    assert "control points among the targets" in document.control.reasons[0]
    assert document.stations[0].status == "fixed"


@pytest.mark.parametrize("wrong_m", [20.0, 300.0, -9000.0])
def test_one_wrong_control_point_is_left_out_however_far_it_is_off(context: StepContext, wrong_m: float) -> None:
    document = registered(context, 2, control=control(wrong_m), fix="control")
    assert document.control is not None
    assert document.control.status == "adjusted"
    assert [point.name for point in document.control.points if point.state == "removed"] == ["P4"]
    for station, pose in zip(document.stations, POSES[:2], strict=True):
        assert station.world_from_scan is not None
        place = np.array(station.world_from_scan.matrix)[:3, 3]
        assert np.linalg.norm(place - (TO_GRID * pose).translation) < 0.01


def test_residuals_beyond_chance_are_doubtful_though_the_control_places_the_stations(context: StepContext) -> None:
    three = control()[:3]
    three[1]["x"] += 15.0 * STD_M  # which one is wrong, three points cannot tell
    document = registered(context, 2, control=three, fix="control")
    assert document.control is not None
    assert document.control.sigma0 is not None
    assert 1.0 < document.control.sigma0 < 5.0
    assert document.control.status == "doubtful"
    assert any("all variances are" in reason for reason in document.control.reasons)
    assert document.control.global_from_project is not None


@pytest.mark.parametrize(("count", "assumed"), [(3, True), (4, False)])
def test_three_control_points_say_what_they_assume(context: StepContext, count: int, assumed: bool) -> None:
    document = registered(context, 2, control=control()[:count], fix="control")
    assert document.control is not None
    assert any("mirror image as well" in reason for reason in document.control.reasons) == assumed


def test_heights_of_three_control_points_that_count_downwards_place_nothing(context: StepContext) -> None:
    downwards = [{**point, "z": -point["z"]} for point in control()[:3]]
    document = registered(context, 2, control=downwards, fix="control")
    assert document.control is not None
    assert document.control.status == "doubtful"
    assert "count downwards" in document.control.reasons[0]
    assert document.control.stations == []


@pytest.mark.parametrize("used", [6, 3])
def test_swapped_axes_of_the_control_are_named_and_it_places_nothing(context: StepContext, used: int) -> None:
    document = registered(context, 2, control=control(axes=(1, 0, 2))[:used], fix="control")
    assert document.control is not None
    assert document.control.status == "doubtful"
    assert "mirror image" in document.control.reasons[0]
    assert document.control.stations == []
