"""Set-ups of a project that is registered already come with the poses that their file states."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pye57
import pytest
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Points
from tests.e2e.other_processes.test_clean_and_colour_over_http import refusal, run
from tests.e2e.running.running_service import Document, RunningService

POSES = [
    (np.eye(3), np.array([0.0, 0.0, 1.5])),
    (Rotation.from_euler("z", 120, degrees=True).as_matrix(), np.array([15.0, 8.0, 2.0])),
]


def ramp(count: int) -> Points:
    rng = np.random.default_rng(3)
    xy = rng.uniform(0.0, 20.0, (count, 2))
    return np.column_stack([xy, 0.05 * xy[:, 0] + rng.normal(0.0, 0.003, count)])


def write_e57(path: Path, scans: Sequence[tuple[Points, Array, Array]]) -> Path:
    file = pye57.E57(str(path), mode="w")
    for points, turn, place in scans:
        data = {f"cartesian{axis}": np.ascontiguousarray(points[:, k]) for k, axis in enumerate("XYZ")}
        x, y, z, w = Rotation.from_matrix(turn).as_quat()
        file.write_scan_raw(data, rotation=np.array([w, x, y, z]), translation=place, name=path.stem)
    file.close()
    return path


def write_ptx(path: Path, scans: Sequence[tuple[Points, Array, Array]]) -> Path:
    with path.open("w") as stream:
        for points, turn, place in scans:
            stream.write(f"1\n{len(points)}\n{' '.join(map(str, place))}\n")
            stream.write("".join(" ".join(f"{v:.9f}" for v in axis) + "\n" for axis in turn.T))
            stream.write("".join(" ".join(f"{v:.9f}" for v in (*axis, 0)) + "\n" for axis in turn.T))
            stream.write(" ".join(map(str, place)) + " 1\n")
            np.savetxt(stream, np.column_stack([points, np.full(len(points), 0.5)]), fmt="%.4f")
    return path


@pytest.fixture(scope="module")
def files(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("posed")
    points = ramp(8_000)
    scans = [((points - place) @ turn, turn, place) for turn, place in POSES]
    paths = [
        write_e57(folder / "registered.e57", scans),
        write_ptx(folder / "registered.ptx", scans),
        write_e57(folder / "second.e57", scans[1:]),
    ]
    np.savetxt(folder / "world.xyz", points, fmt="%.4f")
    return {path.name: service.upload(path)["id"] for path in [*paths, folder / "world.xyz"]}


def both(file: str) -> list[Document]:
    return [{"name": f"S{k}", "scan": {"file": file, "index": k}} for k in range(2)]


def points_of(service: RunningService, result: Document) -> Points:
    (file,) = [each for each in result["files"] if each["name"].endswith(".xyz")]
    rows = service.get(file["href"]).text.splitlines()
    return np.array([row.split()[:3] for row in rows if row[:1] not in "#/"], dtype=np.float64)


@pytest.mark.parametrize("name", ["registered.e57", "registered.ptx"])
def test_transform_takes_the_poses_that_a_file_states_and_says_so(
    service: RunningService, files: dict[str, str], name: str
) -> None:
    result = run(service, "transform", {"stations": both(files[name]), "format": "xyz", "merge": True})
    points = points_of(service, result)
    assert len(points) == 16_000
    assert np.abs(points[:, 2] - 0.05 * points[:, 0]).max() < 0.02
    assert result["poses_from"] == {"S0": "file", "S1": "file"}


def test_transform_to_e57_keeps_the_poses_of_a_registered_file(
    service: RunningService, files: dict[str, str], tmp_path: Path
) -> None:
    result = run(service, "transform", {"stations": both(files["registered.e57"]), "format": "e57"})
    path = tmp_path / "kept.e57"
    path.write_bytes(service.get(result["files"][0]["href"]).content)
    kept = pye57.E57(str(path))
    for index, (turn, place) in enumerate(POSES):
        header = kept.get_header(index)
        assert np.allclose(header.rotation_matrix, turn, atol=1e-12)
        assert np.allclose(header.translation, place, atol=1e-12)


def test_a_terrain_of_registered_setups_lies_where_they_do(service: RunningService, files: dict[str, str]) -> None:
    result = run(service, "terrain", {"stations": both(files["registered.e57"]), "cell_m": 1.0})
    (model,) = [each for each in result["models"] if each["name"] == "dtm"]
    assert (model["lowest_m"], model["highest_m"]) == pytest.approx((0.0, 1.0), abs=0.1)
    assert result["poses_from"] == {"S0": "file", "S1": "file"}


def test_poses_of_files_are_left_aside_where_the_request_says_so(
    service: RunningService, files: dict[str, str]
) -> None:
    inputs = {"stations": both(files["registered.e57"]), "format": "xyz", "merge": True, "poses": "ignore"}
    result = run(service, "transform", inputs)
    points = points_of(service, result)
    assert points[:, 2].min() < -1.4
    assert result["poses_from"] == {"S0": "none", "S1": "none"}


def test_a_pose_of_the_request_comes_before_that_of_the_file(service: RunningService, files: dict[str, str]) -> None:
    raised = np.eye(4)
    raised[2, 3] = 100.0
    station = {**both(files["registered.e57"])[0], "world_from_scan": raised.tolist()}
    result = run(service, "transform", {"stations": [station], "format": "xyz", "merge": True})
    assert points_of(service, result)[:, 2].min() > 98.0
    assert result["poses_from"] == {"S0": "request"}


def test_a_setup_without_a_pose_beside_others_with_one_is_refused(
    service: RunningService, files: dict[str, str]
) -> None:
    stations = [
        {"name": "second", "scan": {"file": files["second.e57"]}},
        {"name": "world", "scan": {"file": files["world.xyz"]}},
    ]
    refused = refusal(service, "clean", {"stations": stations})
    (fault,) = refused["errors"]
    assert fault["pointer"] == "/inputs/stations/1/world_from_scan"
    assert "'second'" in fault["detail"]


def test_a_cloud_with_a_pose_is_compared_with_one_in_the_world_frame(
    service: RunningService, files: dict[str, str]
) -> None:
    inputs = {
        "cloud": [{"name": "second", "scan": {"file": files["second.e57"]}}],
        "reference": [{"name": "world", "scan": {"file": files["world.xyz"]}}],
        "method": "nearest",
    }
    result = run(service, "compare", inputs)
    assert abs(result["figures"]["mean_m"]) < 0.002
    assert result["poses_from"] == {"cloud": {"second": "file"}, "reference": {"world": "none"}}
