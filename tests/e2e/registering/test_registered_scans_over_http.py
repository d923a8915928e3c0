"""What users take away: registered scans with the result of `register`, and later by `transform`."""

import json
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from service.formats import read_scan
from tests.e2e.running.command_line import tieline
from tests.e2e.running.running_service import Document, RunningService


@pytest.fixture(scope="module")
def job(service: RunningService, house: Sequence[Path]) -> Document:
    """Register two stations, and want the E57 files with the poses."""
    files = [service.upload(path) for path in house]
    stations = [{"name": path.stem, "scan": {"file": file["id"]}} for path, file in zip(house, files, strict=True)]
    wanted = {"registered": {"format": "e57"}, "stations": {}, "artifacts": {}}
    body = {"inputs": {"stations": stations}, "outputs": wanted}
    answer = service.post("/processes/register/execution", json=body)
    assert answer.status_code == 201, answer.text
    return {"id": answer.json()["jobID"], "result": service.result(answer.json()["jobID"])}


def pose_of(job: Document, number: int) -> np.ndarray:
    return np.array(job["result"]["stations"][number]["world_from_scan"]["matrix"])


def test_the_uploaded_files_come_back_with_their_poses(
    service: RunningService, job: Document, house: Sequence[Path], tmp_path: Path
) -> None:
    assert [file["name"] for file in job["result"]["registered"]] == [f"{path.stem}-registered.e57" for path in house]
    for number, (file, original) in enumerate(zip(job["result"]["registered"], house, strict=True)):
        content = service.get(file["href"]).content
        assert len(content) == file["bytes"]
        before = original.read_bytes()
        assert content[1024 : len(before)] == before[1024:]
        (tmp_path / file["name"]).write_bytes(content)
        pose = read_scan(tmp_path / file["name"], file["name"]).world_from_scan
        assert pose is not None
        assert np.abs(pose.as_matrix() - pose_of(job, number)).max() < 1e-12


def test_they_are_listed_among_the_downloads_and_the_document_knows_its_own_length(
    service: RunningService, job: Document
) -> None:
    listed = {each["name"]: each["bytes"] for each in job["result"]["artifacts"]}
    assert {file["name"] for file in job["result"]["registered"]} <= listed.keys()
    itself = service.get(f"/jobs/{job['id']}/artifacts/result.json").content
    assert len(itself) == listed["result.json"]


def test_transform_writes_all_stations_of_the_job_into_one_laz_with_standard_deviations(
    service: RunningService, job: Document, house: Sequence[Path], tmp_path: Path
) -> None:
    inputs = {
        "stations": {"jobID": job["id"]},
        "format": "laz",
        "merge": True,
        "per_point_std": True,
        "crs": "EPSG:25832",
    }
    answer = service.post("/processes/transform/execution", json={"inputs": inputs})
    assert answer.status_code == 201, answer.text
    result = service.result(answer.json()["jobID"])
    (file,) = result["files"]
    assert file["stations"] == [path.stem for path in house]
    assert not any("noise" in note for note in file["notes"])  # the registration has estimated it
    (tmp_path / "all.laz").write_bytes(service.get(file["href"]).content)
    cloud = laspy.read(tmp_path / "all.laz")
    scans = [read_scan(path, path.name) for path in house]
    assert len(cloud) == file["points"] == sum(map(len, scans))
    second = np.array(cloud.xyz)[np.array(cloud["station"]) == 1]
    pose = RigidTransform.from_matrix(pose_of(job, 1))
    assert np.abs(second - pose.apply(scans[1].points + scans[1].origin_m)).max() < 6e-5
    std_mm = np.array(cloud["std_mm"])
    assert (std_mm > 0.0).all()
    # the first station is fixed: the noise of its ranges is all
    assert np.ptp(std_mm[np.array(cloud["station"]) == 0]) < 1e-4
    # the second is placed by a pose, whose rotation tells with the distance; the noise of its ranges is its own
    assert np.ptp(std_mm[np.array(cloud["station"]) == 1]) > 0.01


@pytest.mark.parametrize(
    ("inputs", "pointer"),
    [
        ({"crs": "EPSG:4326"}, "/inputs/crs"),
        ({"format": "rcp"}, "/inputs/format"),
        ({"per_point_std": True}, "/inputs/stations/0/world_from_scan"),
        (
            {"pose": [[2.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]},
            "/inputs/stations/0/world_from_scan",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(
    service: RunningService, house: Sequence[Path], inputs: Document, pointer: str
) -> None:
    file = service.upload(house[0])
    station = {"name": "A", "scan": {"file": file["id"]}, "world_from_scan": inputs.get("pose", np.eye(4).tolist())}
    body = {"inputs": {**{k: v for k, v in inputs.items() if k != "pose"}, "stations": [station]}}
    answer = service.post("/processes/transform/execution", json=body)
    assert answer.status_code == 400
    assert [fault["pointer"] for fault in answer.json()["errors"]] == [pointer]


def test_the_command_line_writes_a_file_in_its_pose(
    service: RunningService, house: Sequence[Path], tmp_path: Path
) -> None:
    pose = [[0.0, -1.0, 0.0, 500_000.0], [1.0, 0.0, 0.0, 5_400_000.0], [0.0, 0.0, 1.0, 300.0], [0.0, 0.0, 0.0, 1.0]]
    (tmp_path / "poses.json").write_text(json.dumps({house[0].stem: pose}))
    said = ("--poses", tmp_path / "poses.json", "--format", "ply", "--output", tmp_path / "out", "--url", service.url)
    done = tieline("transform", house[0], *said)
    assert done.returncode == 0, done.stderr
    scan = read_scan(house[0], house[0].name)
    name = f"{house[0].stem}-registered.ply"
    found = read_scan(tmp_path / "out" / name, name)
    expected = RigidTransform.from_matrix(np.array(pose)).apply(scan.points + scan.origin_m)
    assert np.abs(found.points + found.origin_m - expected).max() < 2e-9
