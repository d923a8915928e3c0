"""Three stations of a hall go in over HTTP; they come out adjusted together, controlled by their loop."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.systematic_errors import SystematicErrors
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_scans import SCANNER, simulate, write_scans

pytestmark = pytest.mark.service

SCENE, STATIONS = "pipe_hall", 3
TARGETS, TARGET_STD_M = 6, 0.004


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    return write_scans(tmp_path_factory.mktemp("hall"), simulate(SCENE, STATIONS))


@pytest.fixture(scope="module")
def result(service: RunningService, hall: Sequence[Path]) -> Document:
    forms = [("scan", (path.name, path.read_bytes())) for path in hall]
    answer = service.post("/registrations", files=forms)
    assert answer.status_code == 201, answer.text
    return service.result(answer.json()["jobID"])


def test_all_stations_are_registered_true_to_their_covariance(result: Document) -> None:
    assert result["status"] == "registered"
    poses = SCENES[SCENE]().stations
    for k, station in enumerate(result["stations"][1:], start=1):
        document, truth = station["world_from_scan"], poses[0].inv() * poses[k]
        estimate = RigidTransform.from_matrix(np.array(document["matrix"]))
        error = np.concatenate(
            [(truth.rotation * estimate.rotation.inv()).as_rotvec(), truth.translation - estimate.translation]
        )
        assert error @ np.linalg.solve(np.array(document["covariance"]), error) < 27.9  # chi-square, 6 degrees, 0.01 %
        assert np.linalg.norm(error[3:]) < 0.003


def stated_targets(places: np.ndarray, offset_m: float, rng: np.random.Generator) -> list[Document]:
    """Measure targets by a scanner at the origin whose ranges are too long."""
    ranges = np.linalg.norm(places, axis=1, keepdims=True)
    # more precise ones would contradict each other in the pairs, which are doubtful then
    seen = places * (1.0 + offset_m / ranges) + rng.normal(0.0, TARGET_STD_M, places.shape)
    return [
        dict(zip("xyz", place, strict=True), name=f"T{k}", std=TARGET_STD_M) for k, place in enumerate(seen.tolist())
    ]


def test_a_scanner_out_of_adjustment_is_found_and_said_and_changes_nothing_unless_asked(
    service: RunningService, tmp_path: Path
) -> None:
    scanner = replace(SCANNER, systematic=SystematicErrors(range_offset_m=0.005))
    scene = SCENES[SCENE]()
    rng = np.random.default_rng(1)
    scans = list(simulate_stations(scene, scene.stations[:STATIONS], scanner, rng))
    files = [service.upload(path)["id"] for path in write_scans(tmp_path, scans)]
    places = scene.stations[0].apply(rng.uniform([-6.0, -3.0, -1.0], [6.0, 3.0, 2.0], (TARGETS, 3)))
    stations = [
        {"name": f"S{k}", "scan": {"file": file}, "targets": stated_targets(pose.inv().apply(places), 0.005, rng)}
        for k, (file, pose) in enumerate(zip(files, scene.stations, strict=False))
    ]
    inputs = {"stations": stations, "scanner": {"estimate": "auto", "tripod": "auto"}}
    network = service.result(service.execute("register", inputs))["network"]
    assert "instruments" in network, network["remarks"]
    found = network["instruments"]
    offset = next(error for error in found["errors"] if error["error"] == "range_offset")
    assert offset["significant"]
    assert abs(offset["value"] - 5.0) < 4.0 * offset["std"]
    assert "range offset" in found["recommendation"]
    assert found["targets"] == TARGETS
    assert not found["applied"]


def test_the_loop_closes_and_controls_every_pair(result: Document) -> None:
    network = result["network"]
    assert [loop["passed"] for loop in network["loops"]] == [True]
    assert [link["state"] for link in network["links"]] == ["used"] * STATIONS


def test_one_adjustment_of_all_stations_carries_the_poses(result: Document) -> None:
    adjustment = result["network"]["adjustment"]
    assert (adjustment["unknowns"], adjustment["converged"]) == (12, True)
    assert adjustment["redundancy"] == adjustment["observations"] - 12
    assert adjustment["tracks"]["planes"] >= 5
