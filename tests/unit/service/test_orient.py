"""Process `orient`: three scans of a room with bad poses come to lie on each other, at far coordinates too."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.scans.scan import Scan
from schemas.requests.orient import OrientDocument
from service.adapters.files.local_files import LocalFiles
from service.formats.writers import write_scans
from service.ports import Json, StepContext
from service.processes import OFFERED_PROCESSES, STEPS
from service.use_cases.inputs.validate_request import validated

NAMES = ("A", "B", "C")
TRUTH = {
    "A": RigidTransform.identity(),
    "B": RigidTransform.from_components([1.0, 0.5, 0.1], Rotation.from_rotvec([0.02, 0.0, 0.7])),
    "C": RigidTransform.from_components([-0.8, 1.1, 0.0], Rotation.from_rotvec([0.0, -0.03, -1.2])),
}
OFF = {
    "A": RigidTransform.identity(),
    "B": RigidTransform.from_components([0.06, -0.05, 0.04], Rotation.from_rotvec([0.01, -0.01, 0.02])),
    "C": RigidTransform.from_components([-0.05, 0.04, 0.06], Rotation.from_rotvec([-0.01, 0.02, -0.01])),
}
FAR = RigidTransform.from_translation([500_000.0, 5_300_000.0, 100.0])


class Progress:
    def report(self, fraction: float, message: str) -> None:
        assert 0.0 <= fraction <= 1.0, message


def room(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, 20_000))
    sides = [
        np.column_stack([6 * u, 4 * v, 0 * u]),
        np.column_stack([0 * u, 4 * u, 3 * v]),
        np.column_stack([6 * u, 0 * u, 3 * v]),
        np.column_stack([6 * u, 4 - 0.2 * u, 3 * v]),
    ]
    return np.asarray(np.choose(rng.integers(0, 4, len(u))[:, None], sides) + rng.normal(0.0, 0.002, (len(u), 3)))


def walls(seed: int) -> np.ndarray:
    """Three parallel walls, which fix nothing along them."""
    u, v = np.random.default_rng(seed).random((2, 20_000))
    return np.column_stack([6 * u, np.resize([0.0, 3.0, 4.0], len(u)), 3 * v])


@pytest.fixture
def context(tmp_path: Path) -> StepContext:
    return scanned(tmp_path, room)


def scanned(tmp_path: Path, surface: Callable[[int], np.ndarray]) -> StepContext:
    blobs = LocalFiles(tmp_path / "store")
    for seed, name in enumerate(NAMES):
        points = TRUTH[name].inv().apply(surface(seed))
        write_scans(tmp_path / f"{name}.e57", [Scan(points=points, origin_m=np.zeros(3), name=name)])
        blobs.put_file(f"files/{name * 64}", tmp_path / f"{name}.e57")
    limits = {"max_points": 10**6, "max_photo_pixels": 10**6, "min_free_bytes": 0}
    return StepContext(blobs, Progress(), limits)


def job(world: RigidTransform, off: dict[str, RigidTransform], **more: Any) -> Json:
    stations = [
        {
            "name": name,
            "scan": {"file": name},
            "world_from_scan": (world * off[name] * TRUTH[name]).as_matrix().tolist(),
        }
        for name in NAMES
    ]
    process = OFFERED_PROCESSES["orient"]
    inputs = validated(process.request_model, {"inputs": {"stations": stations, **more}}).inputs
    files = {name: {"name": f"{name}.e57", "sha256": name * 64} for name in NAMES}
    return {"id": "j", "inputs": inputs.model_dump(mode="json", by_alias=True), "files": files}


def ran(context: StepContext, asked: Json) -> OrientDocument:
    (call,) = OFFERED_PROCESSES["orient"].plan.next_stage(asked, []) or ()
    STEPS[call.name](context, call.arguments)
    return OrientDocument.model_validate_json(context.blobs.local_path("jobs/j/result.json").read_bytes())


@pytest.mark.parametrize("world", [RigidTransform.identity(), FAR], ids=["near", "far"])
def test_three_clouds_come_to_their_places_and_the_fixed_one_stays(context: StepContext, world: RigidTransform) -> None:
    document = ran(context, job(world, OFF))
    assert document.converged
    assert document.neighbours == [("A", "B"), ("A", "C"), ("B", "C")]
    for station in document.stations:
        error = (world * TRUTH[station.name]).inv() * RigidTransform.from_matrix(np.array(station.world_from_scan))
        assert float(error.rotation.magnitude()) < 0.001
        assert float(np.linalg.norm(error.translation)) < 0.003
    assert document.stations[0].fixed
    assert document.stations[0].shift_m == 0.0
    poses = json.loads(context.blobs.local_path("jobs/j/artifacts/poses.json").read_text())
    assert poses["B"] == [list(row) for row in document.stations[1].world_from_scan]


def test_another_station_may_be_the_fixed_one(context: StepContext) -> None:
    document = ran(context, job(RigidTransform.identity(), OFF, fixed=["B"]))
    assert [station.fixed for station in document.stations] == [False, True, False]
    assert document.stations[1].shift_m == 0.0
    assert document.stations[0].shift_m > 0.01


def test_a_cloud_that_lies_on_no_other_is_named(context: StepContext) -> None:
    away = {**OFF, "C": RigidTransform.from_translation([300.0, 0.0, 0.0])}
    with pytest.raises(TooFewCorrespondencesError, match="points of C"):
        ran(context, job(RigidTransform.identity(), away))


def ties() -> list[Json]:
    """Five details of the walls, as B and C have them in their photos beside those of A."""
    details = np.array([[0.5, 0.0, 0.4], [5.5, 0.0, 2.7], [3.0, 3.0, 2.0], [1.0, 4.0, 2.5], [5.0, 4.0, 0.3]])
    own = {name: TRUTH[name].inv().apply(details) for name in NAMES}
    return [
        {"first": "A", "second": name, "points": np.hstack([own["A"], own[name]]).tolist(), "weight": 10.0}
        for name in ("B", "C")
    ]


def test_tie_points_hold_what_the_surfaces_leave_free(tmp_path: Path) -> None:
    context = scanned(tmp_path, walls)
    with pytest.raises(DegenerateGeometryError):
        ran(context, job(FAR, OFF))
    document = ran(context, job(FAR, OFF, ties=ties()))
    for station in document.stations:
        error = (FAR * TRUTH[station.name]).inv() * RigidTransform.from_matrix(np.array(station.world_from_scan))
        assert float(np.linalg.norm(error.translation)) < 0.001
    assert [(tie.first, tie.second) for tie in document.ties] == [("A", "B"), ("A", "C")]
    assert max(max(tie.distances_m) for tie in document.ties) < 0.001


def test_a_point_that_was_mixed_up_is_far_from_its_partner(context: StepContext) -> None:
    wrong = ties()[:1]
    wrong[0]["points"][2][0] += 0.5
    wrong[0]["weight"] = 1.0
    (tie,) = ran(context, job(RigidTransform.identity(), OFF, ties=wrong)).ties
    assert np.argmax(tie.distances_m) == 2
    assert tie.distances_m[2] > 0.45
