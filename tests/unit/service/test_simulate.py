"""Process `simulate`: its plan, its steps, and that its tables are those of the numerics."""

import json
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import RigidTransform

from algorithms.simulation.instruments import INSTRUMENTS
from algorithms.simulation.reflectances import MATERIALS
from algorithms.simulation.scenes import SCENES
from schemas.requests import simulate_inputs
from schemas.requests.simulate_inputs import SimulateInputs
from schemas.results.simulation_result import SimulationDocument
from service.adapters.files.local_files import LocalFiles
from service.errors import InvalidRequestError
from service.formats import read_scan
from service.formats.base import ReadLimits
from service.ports import Json, StepContext
from service.processes import OFFERED_PROCESSES, STEPS
from service.processes.simulate import pairs_to_try
from service.processes.simulate.scanning import scanner_of
from service.use_cases.inputs.validate_request import validated


class Progress:
    def report(self, fraction: float, message: str) -> None:
        assert 0.0 <= fraction <= 1.0, message


@pytest.fixture
def context(tmp_path: Path) -> StepContext:
    return StepContext(LocalFiles(tmp_path / "store"), Progress(), {"max_points": 10**6, "min_free_bytes": 0})


def wall(name: str, outline: list[list[float]], **more: Any) -> Json:
    return {"name": name, "outline_m": outline, **more}


ROOM = [
    wall("floor", [[0, 0, 0], [8, 0, 0], [8, 5, 0], [0, 5, 0]], material="cement"),
    wall("west", [[0, 0, 0], [0, 5, 0], [0, 5, 3], [0, 0, 3]]),
    wall("south", [[0, 0, 0], [8, 0, 0], [8, 0, 3], [0, 0, 3]], reflectance=0.3),
    wall("east", [[8, 0, 0], [8, 3, 0], [8, 3, 3], [8, 0, 3]]),
]
STATIONS = [
    {"name": "A", "position_m": [2.0, 2.0, 1.5]},
    {"name": "B", "position_m": [5.0, 3.0, 1.6], "heading_gon": 50.0, "tilt_x_gon": 3.0},
]


def inputs(**more: Any) -> Json:
    said = {"planes": ROOM, "stations": STATIONS, "step_gon": 1.0, "expect": False, **more}
    request = {key: value for key, value in said.items() if value is not None}
    return SimulateInputs.model_validate(request).model_dump(mode="json", by_alias=True)


def job(**more: Any) -> Json:
    return {"id": "j", "process_id": "simulate", "inputs": inputs(**more), "files": {}}


def ran(context: StepContext, job: Json) -> tuple[SimulationDocument, list[str]]:
    plan, names = OFFERED_PROCESSES["simulate"].plan, list[str]()
    outputs: list[list[Json]] = []
    while (calls := plan.next_stage(job, outputs)) is not None:
        names += [call.name for call in calls]
        outputs.append([json.loads(json.dumps(STEPS[call.name](context, call.arguments))) for call in calls])
    return SimulationDocument.model_validate_json(context.blobs.local_path("jobs/j/result.json").read_bytes()), names


def test_the_tables_of_the_interface_are_those_of_the_numerics() -> None:
    assert set(get_args(simulate_inputs.SceneName)) == set(SCENES)
    assert set(get_args(simulate_inputs.MaterialName)) == set(MATERIALS)
    assert set(get_args(simulate_inputs.InstrumentName)) == set(INSTRUMENTS)


@pytest.mark.parametrize("name", ["e57", "ptx"])
def test_scans_of_given_planes_lie_on_them_in_their_true_poses(context: StepContext, name: str) -> None:
    document, names = ran(context, job(format=name, with_poses=True))
    assert names == ["plan-setups", "simulate-station", "simulate-station", "report-simulation"]
    truth = json.loads(context.blobs.local_path("jobs/j/artifacts/truth.json").read_text())
    limits = ReadLimits(max_points=10**6)
    for station in document.stations:
        path = context.blobs.local_path(f"jobs/j/artifacts/{station.file}")
        scan = read_scan(path, station.file, 0, limits)
        assert scan.world_from_scan is not None
        pose = RigidTransform.from_matrix(np.array(truth[station.name]))
        np.testing.assert_allclose(scan.world_from_scan.as_matrix(), pose.as_matrix(), atol=1e-9)
        world = pose.apply(scan.points + scan.origin_m)
        off = np.min([np.abs(world[:, 2]), np.abs(world[:, 0]), np.abs(world[:, 1]), np.abs(world[:, 0] - 8)], axis=0)
        assert float(np.quantile(off, 0.99)) < 0.01
        assert station.points == len(scan)


def test_without_poses_the_files_keep_the_truth_to_themselves(context: StepContext) -> None:
    document, _ = ran(context, job())
    scan = read_scan(context.blobs.local_path("jobs/j/artifacts/A.e57"), "A.e57", 0, ReadLimits(max_points=10**6))
    assert scan.world_from_scan is None
    assert document.connected is None
    assert document.pairs == []


def test_the_same_seed_gives_the_same_scan_and_another_one_another(context: StepContext) -> None:
    contents = []
    for seed in (1, 1, 2):
        ran(context, job(seed=seed, format="ply"))
        contents.append(context.blobs.local_path("jobs/j/artifacts/B.ply").read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_a_scan_does_not_depend_on_the_other_set_ups_that_follow(context: StepContext) -> None:
    ran(context, job(format="ply"))
    both = context.blobs.local_path("jobs/j/artifacts/A.ply").read_bytes()
    ran(context, job(format="ply", stations=STATIONS[:1]))
    assert context.blobs.local_path("jobs/j/artifacts/A.ply").read_bytes() == both


def test_photos_are_listed_as_a_registration_takes_them(context: StepContext) -> None:
    document, _ = ran(context, job(photos={"count": 2, "scale": 0.05}, stations=STATIONS[:1]))
    assert [photo.name for photo in document.stations[0].photos] == ["A-photo-1.png", "A-photo-2.png"]
    listed = json.loads(context.blobs.local_path("jobs/j/artifacts/photos.json").read_text())
    photo = listed["stations"][0]["photos"][1]
    assert photo["file"] == "A-photo-2.png"
    assert (photo["camera"]["width"], photo["camera"]["height"]) == (150, 100)
    assert np.array(photo["scan_from_camera"]).shape == (4, 4)


def test_a_set_up_that_sees_nothing_is_named(context: StepContext) -> None:
    away = [{"name": "far", "position_m": [5000.0, 0.0, 0.0]}]
    with pytest.raises(InvalidRequestError, match="'far' only 0 points"):
        ran(context, job(stations=away))


def test_of_many_set_ups_each_is_registered_to_its_nearest_ones() -> None:
    places = [(5.0 * k, 0.0, 0.0) for k in range(20)]
    pairs = pairs_to_try(places)
    assert len(pairs) < 20 * 19 / 2
    assert {(k, k + 1) for k in range(19)} <= set(pairs)
    assert len(pairs_to_try(places[:8])) == 28


@pytest.mark.parametrize(
    ("said", "where"),
    [
        ({"scene": "house"}, "/inputs"),
        ({"planes": None, "stations": None}, "/inputs"),
        ({"stations": None}, "/inputs"),
        ({"step_gon": 0.001}, "/inputs/step_gon"),
        ({"instrument": "my own"}, "/inputs/instrument"),
        ({"planes": [wall("two", [[0, 0, 0], [1, 0, 0]])]}, "/inputs/planes/0/outline_m"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_place(said: Json, where: str) -> None:
    request = {"planes": ROOM, "stations": STATIONS, **said}
    process = OFFERED_PROCESSES["simulate"]
    with pytest.raises(InvalidRequestError) as caught:
        validated(process.request_model, {"inputs": {k: v for k, v in request.items() if v is not None}})
    assert caught.value.faults[0].pointer.startswith(where)


@pytest.mark.slow
def test_a_network_to_be_is_registered_and_its_standard_deviations_hold(context: StepContext) -> None:
    document, names = ran(context, job(planes=None, scene="pipe_hall", stations=None, step_gon=0.8, expect=True))
    assert "adjust-network" in names or len(document.stations) == 2
    assert document.connected
    assert len(document.pairs) == len(document.stations) * (len(document.stations) - 1) // 2
    for station in document.stations[1:]:
        assert station.expected_status == "registered"
        assert station.expected_std is not None
        assert station.error_m is not None
        std = station.expected_std
        spread = np.linalg.norm([each for each in (std.tx_m, std.ty_m, std.tz_m) if each is not None])
        assert station.error_m < 5.0 * spread
    assert 0.3 < document.pairs[0].overlap_0_5m <= 1.0


def test_errors_are_those_that_the_request_names() -> None:
    said = {
        "vertical_index_mgon": 10.0, "range_offset_mm": 2.0, "range_scale_ppm": 30.0, "collimation_mgon": 4.0,
        "trunnion_mgon": -5.0, "tripods": [{"station": "B", "tilt_y_mgon": 5.0}],
    }  # fmt: skip
    still, turning = (scanner_of(inputs(errors=said), name).systematic for name in ("A", "B"))
    mgon = np.pi / 200.0 * 1e-3
    assert (still.range_offset_m, still.drift_rad) == (0.002, (0.0, 0.0, 0.0))
    assert still.vertical_index_error_rad == pytest.approx(10.0 * mgon)
    assert still.trunnion_error_rad == pytest.approx(-5.0 * mgon)
    assert still.range_scale_error == pytest.approx(30e-6)
    assert turning.drift_rad == pytest.approx((0.0, 5.0 * mgon, 0.0))


def test_a_range_offset_lengthens_the_ranges_of_a_simulated_scan(context: StepContext) -> None:
    limits, found = ReadLimits(max_points=10**6), []
    for errors in (None, {"range_offset_mm": 500.0}):
        document, _ = ran(context, job(stations=STATIONS[:1], errors=errors))
        file = document.stations[0].file
        found.append(read_scan(context.blobs.local_path(f"jobs/j/artifacts/{file}"), file, 0, limits))
    plain, longer = (float(np.median(np.linalg.norm(scan.points + scan.origin_m, axis=1))) for scan in found)
    assert longer - plain == pytest.approx(0.5, abs=0.02)


@pytest.mark.slow
def test_photos_of_a_wrong_mount_have_a_stated_pose_besides_the_true_one(context: StepContext) -> None:
    errors = {"mount_rotation_mgon": [127.0, 0.0, 0.0], "mount_shift_mm": [0.0, 5.0, 0.0]}
    photos = {"count": 1, "scale": 0.05}
    document, _ = ran(context, job(stations=STATIONS[:1], photos=photos, errors=errors))
    (photo,) = document.stations[0].photos
    true, stated = (
        RigidTransform.from_matrix(np.array(rows)) for rows in (photo.scan_from_camera, photo.stated_scan_from_camera)
    )
    np.testing.assert_allclose((stated.inv() * true).rotation.as_rotvec(), [1.995e-3, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose((stated.inv() * true).translation, [0.0, 0.005, 0.0], atol=1e-9)
    listed = json.loads(context.blobs.local_path("jobs/j/artifacts/photos.json").read_text())
    (of_list,) = listed["stations"][0]["photos"]
    assert set(of_list) == {"file", "camera", "scan_from_camera"}
    assert of_list["scan_from_camera"] == [list(row) for row in photo.stated_scan_from_camera]


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ({"tripods": [{"station": "C"}]}, "no station C"),
        ({"mount_shift_mm": [1.0, 0.0, 0.0]}, "no `photos` are taken"),
    ],
)
def test_errors_of_what_is_not_there_are_refused(errors: Json, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        inputs(errors=errors)
