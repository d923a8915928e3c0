"""Two scans in LAS, rounded to centimetres, go in over HTTP; the answer knows that it is no better than that."""

from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.simulation.scenes import SCENES
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_scans import simulate

pytestmark = pytest.mark.slow

STEP_M = 0.01
SHIFT_M = np.array([0.0037, -0.0043, 0.0031])
"""Of the second scan, so that walls lie elsewhere between its steps."""


def write_las(path: Path, points: np.ndarray) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, STEP_M), np.zeros(3)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)
    return path


@pytest.fixture(scope="module")
def rounded_house(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Two stations of the house, levelled and in the project's axes."""
    folder, stations = tmp_path_factory.mktemp("rounded"), SCENES["house"]().stations
    shifts = np.zeros(3), SHIFT_M
    return [
        write_las(folder / f"{scan.name}.las", station.rotation.apply(scan.points) + shift)
        for scan, station, shift in zip(simulate("house"), stations, shifts, strict=False)
    ]


@pytest.fixture(scope="module")
def result(service: RunningService, rounded_house: Sequence[Path]) -> Document:
    answer = service.post("/registrations", files=[("scan", (path.name, path.read_bytes())) for path in rounded_house])
    assert answer.status_code == 201, answer.text
    return service.result(answer.json()["jobID"])


def test_each_station_names_the_step_of_its_coordinates(result: Document) -> None:
    for count in result["features"]:
        assert count["coordinate_step_m"] == pytest.approx([STEP_M] * 3, rel=1e-3)
        assert count["noise_std_m"] >= 0.99 * STEP_M / 12.0**0.5


def test_the_reasons_say_that_rounding_dominates(result: Document) -> None:
    (pair,) = result["pairs"]
    assert any("coordinates are rounded to 10 mm" in reason for reason in pair["reasons"]), pair["reasons"]


def test_rounding_is_not_taken_for_a_deformation(result: Document) -> None:
    (pair,) = result["pairs"]
    assert pair["status"] == "accepted", pair["reasons"]
    assert not any("differ by more than a motion" in reason for reason in pair["reasons"]), pair["reasons"]


def test_the_pose_is_as_good_as_it_says(result: Document) -> None:
    stations = SCENES["house"]().stations
    pose = result["pairs"][0]["target_from_source"]
    estimate = RigidTransform.from_matrix(np.array(pose["matrix"]))
    truth = stations[1].translation - stations[0].translation - SHIFT_M
    error = np.concatenate([-estimate.rotation.as_rotvec(), truth - estimate.translation])
    covariance = np.array(pose["covariance"])
    assert error @ np.linalg.solve(covariance, error) < 30.0
    assert np.sqrt(np.diag(covariance))[3:].min() > 1e-4  # m


def test_no_extracted_plane_is_better_than_its_rounding(service: RunningService, rounded_house: Sequence[Path]) -> None:
    file = service.upload(rounded_house[0])
    station = {"name": "garden", "scan": {"file": file["id"], "index": 0}}
    planes = service.result(service.execute("extract-lines", {"station": station}))["planes"]
    assert min(np.sqrt(plane["covariance"][2][2]) for plane in planes) > 1e-5  # m
    assert min(plane["noise_std_m"] for plane in planes) >= 0.99 * STEP_M / 12.0**0.5
