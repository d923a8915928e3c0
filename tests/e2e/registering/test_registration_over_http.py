"""Two stations of a house go in over HTTP; a pose with honest standard deviations comes out."""

import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_scans import first_from_second

PARAMETERS = ("omega_gon", "phi_gon", "kappa_gon", "tx_m", "ty_m", "tz_m")


@pytest.fixture(scope="module")
def from_command_line(
    service: RunningService, house: Sequence[Path]
) -> "Iterator[Future[subprocess.CompletedProcess[str]]]":
    """Let the command line register the same scans meanwhile."""
    with ThreadPoolExecutor(1) as other:
        yield other.submit(tieline, "register", *house, "--url", service.url)


@pytest.fixture(scope="module")
def result(
    service: RunningService,
    house: Sequence[Path],
    from_command_line: "Future[subprocess.CompletedProcess[str]]",  # noqa: ARG001 - to be started first
) -> Document:
    forms = [("scan", (path.name, path.read_bytes())) for path in house]
    answer = service.post("/registrations", files=forms)
    assert answer.status_code == 201, answer.text
    assert answer.headers["location"] == f"{service.url}/jobs/{answer.json()['jobID']}"
    return service.result(answer.json()["jobID"])


def test_both_stations_bear_the_names_of_their_files_and_are_registered_by_an_accepted_pair(
    result: Document, house: Sequence[Path]
) -> None:
    assert result["status"] == "registered"
    assert [(station["name"], station["status"]) for station in result["stations"]] == [
        (house[0].stem, "fixed"),
        (house[1].stem, "registered"),
    ]
    pairs = [(pair["target"], pair["source"], pair["status"]) for pair in result["pairs"]]
    assert pairs == [(house[0].stem, house[1].stem, "accepted")]
    assert [each["name"] for each in result["provenance"]["inputs"]] == [path.name for path in house]


def test_the_pose_is_true_within_four_of_its_standard_deviations(result: Document) -> None:
    pose, truth = result["stations"][1]["world_from_scan"], first_from_second("house")
    estimate = RigidTransform.from_matrix(np.array(pose["matrix"]))
    # the covariance's own perturbation: rotation vector on the left, then translation
    turn = (estimate.rotation * truth.rotation.inv()).as_rotvec()
    error = np.concatenate([turn, estimate.translation - truth.translation])
    std = np.sqrt(np.diag(np.array(pose["covariance"])))
    assert (np.abs(error) < 4.0 * std).all(), error / std


def test_the_pose_is_true_within_a_fiftieth_of_a_gon_and_five_millimetres(result: Document) -> None:
    pose, truth = result["stations"][1]["world_from_scan"], first_from_second("house")
    estimate = RigidTransform.from_matrix(np.array(pose["matrix"]))
    assert (estimate.rotation.inv() * truth.rotation).magnitude() * 200.0 / np.pi < 0.02
    assert np.linalg.norm(estimate.translation - truth.translation) < 0.005


def test_every_parameter_has_a_standard_deviation_and_the_covariance_is_one(result: Document) -> None:
    pose = result["stations"][1]["world_from_scan"]
    covariance = np.array(pose["covariance"])
    assert all(0.0 < pose["std"][name] < 0.02 for name in PARAMETERS)
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12)
    assert (np.linalg.eigvalsh(covariance) > 0.0).all()
    # t = t0 + dt: the standard deviations of the shift are those of the matrix
    assert np.sqrt(np.diag(covariance))[3:] == pytest.approx([pose["std"][name] for name in PARAMETERS[3:]], rel=1e-9)


def test_every_download_that_the_result_lists_can_be_fetched(
    service: RunningService, result: Document, house: Sequence[Path]
) -> None:
    names = {artifact["name"] for artifact in result["artifacts"]}
    assert names >= {"poses.csv", "correspondences.csv", f"{house[1].stem}.txt"}
    for artifact in result["artifacts"]:
        answer = service.http.get(artifact["href"])
        assert (answer.status_code, len(answer.content)) == (200, artifact["bytes"]), artifact


def test_lines_come_with_a_positive_covariance_of_four_by_four(service: RunningService, house: Sequence[Path]) -> None:
    file = service.upload(house[0])
    station = {"name": "garden", "scan": {"file": file["id"], "index": 0}}
    answer = service.result(service.execute("extract-lines", {"station": station}))
    assert len(answer["lines"]) == answer["features"]["lines"] >= 6
    covariances = np.array([line["covariance"] for line in answer["lines"]])
    assert covariances.shape[1:] == (4, 4)
    assert (np.linalg.eigvalsh(covariances) > 0.0).all()


def test_the_command_line_prints_the_parameters_and_ends_with_0(
    from_command_line: "Future[subprocess.CompletedProcess[str]]",
) -> None:
    done = from_command_line.result()
    assert (done.returncode, "house-2: registered" in done.stdout) == (0, True), done.stdout + done.stderr


def test_the_command_line_ends_with_2_when_a_file_is_bad(service: RunningService, tmp_path: Path) -> None:
    (tmp_path / "photo.e57").write_bytes(b"\xff\xd8\xff" + bytes(100))
    done = tieline("register", tmp_path / "photo.e57", tmp_path / "photo.e57", "--url", service.url)
    assert (done.returncode, "photo.e57: " in done.stderr) == (2, True), done.stdout + done.stderr
