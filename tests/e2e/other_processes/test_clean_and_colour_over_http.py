"""Registered scans go in over HTTP; cleaned and coloured points come out, every step counted."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.simulation.scenes import SCENES
from service.formats import read_scan
from tests.e2e.running.running_service import Document, RunningService
from tests.e2e.running.virtual_photos import take_photos

SHIFT_M = np.array([500_000.0, 5_600_000.0, 0.0])
"""The project lies far from the origin of its coordinates."""


def poses() -> Sequence[list[list[float]]]:
    """Give the true poses of the first stations, in far coordinates."""
    rows = [pose.as_matrix() for pose in SCENES["house"]().stations[:2]]
    for matrix in rows:
        matrix[:3, 3] += SHIFT_M
    return [matrix.tolist() for matrix in rows]


@pytest.fixture(scope="module")
def stations(service: RunningService, house: Sequence[Path]) -> list[Document]:
    return [
        {"name": f"S{k}", "scan": {"file": service.upload(path)["id"]}, "world_from_scan": pose}
        for k, (path, pose) in enumerate(zip(house, poses(), strict=True), start=1)
    ]


def run(service: RunningService, process: str, inputs: Document, outputs: Document | None = None) -> Document:
    answer = service.post(f"/processes/{process}/execution", json={"inputs": inputs, "outputs": outputs or {}})
    assert answer.status_code == 201, answer.text
    return service.result(answer.json()["jobID"])


def refusal(service: RunningService, process: str, inputs: Document) -> Document:
    answer = service.post(f"/processes/{process}/execution", json={"inputs": inputs})
    assert answer.status_code in {400, 422}, answer.text
    document: Document = answer.json()
    return document


def downloaded(service: RunningService, artifact: Document, tmp_path: Path) -> Any:
    path = tmp_path / str(artifact["name"])
    path.write_bytes(service.get(str(artifact["href"])).content)
    return read_scan(path, path.name)


def test_scans_are_cropped_cleaned_and_thinned_and_every_step_is_counted(
    service: RunningService, stations: list[Document], tmp_path: Path
) -> None:
    low, high = SHIFT_M - np.array([6.0, 6.0, 1.0]), SHIFT_M + np.array([6.0, 6.0, 4.0])
    options = {"box": {"lowest_m": low.tolist(), "highest_m": high.tolist()}, "voxel": {"voxel_m": 0.05}}
    result = run(
        service, "clean", {"stations": stations, "cleaning": options}, {"cleaned": {"format": "laz"}, "steps": {}}
    )
    steps = result["steps"]
    assert [step["step"] for step in steps] == [name for name in ("comet_tails", "box", "voxel") for _ in range(2)]
    assert all(step["after"] == step["before"] - step["removed"] for step in steps)
    (file,) = result["cleaned"]
    scan = downloaded(service, file, tmp_path)
    assert len(scan) == sum(step["after"] for step in steps if step["step"] == "voxel")
    points = scan.points + scan.origin_m
    assert (points >= low - 1e-3).all()
    assert (points <= high + 1e-3).all()


@pytest.mark.parametrize(("wanted", "files"), [({"format": "laz"}, 2), ({"format": "e57", "merge": True}, 1)])
def test_files_in_the_common_frame_are_written_cleaned(
    service: RunningService, stations: list[Document], tmp_path: Path, wanted: Document, files: int
) -> None:
    low, high = SHIFT_M - np.array([6.0, 6.0, 1.0]), SHIFT_M + np.array([6.0, 6.0, 4.0])
    cleaning = {
        "box": {"lowest_m": low.tolist(), "highest_m": high.tolist()},
        "moved_objects": {},
        "comet_tails": False,
    }
    result = run(service, "transform", {"stations": stations, "cleaning": cleaning, **wanted})
    assert len(result["files"]) == files
    for file in result["files"]:
        assert [step["step"] for step in file["cleaning"]] == [
            step for step in ("box", "moved_objects") for _ in file["stations"]
        ]
        left = sum(step["after"] for step in file["cleaning"] if step["step"] == "moved_objects")
        scan = downloaded(service, file, tmp_path)
        assert len(scan) <= file["points"] == left
        points = scan.points + scan.origin_m
        assert (points >= low - 1e-3).all()
        assert (points <= high + 1e-3).all()


def test_rows_and_columns_cannot_be_kept_of_cleaned_scans(service: RunningService, stations: list[Document]) -> None:
    problem = refusal(service, "transform", {"stations": stations, "cleaning": {}, "format": "ptx"})
    assert "exclude each other" in str(problem)


def test_a_polygon_of_two_points_is_refused_before_anything_is_computed(
    service: RunningService, stations: list[Document]
) -> None:
    options = {"polygon": {"corners_m": [[0.0, 0.0], [1.0, 1.0]]}}
    problem = refusal(service, "clean", {"stations": stations, "cleaning": options})
    assert "2 corners enclose nothing" in str(problem)


def test_a_box_that_holds_nothing_is_an_error_that_says_so(service: RunningService, stations: list[Document]) -> None:
    options = {"box": {"lowest_m": [0.0, 0.0, 0.0], "highest_m": [1.0, 1.0, 1.0]}}
    job = service.finished(service.execute("clean", {"stations": stations, "cleaning": options}))
    assert job["status"] == "failed"
    assert "is left" in str(job)


def test_points_get_the_colours_of_the_photos_of_all_stations(
    service: RunningService, stations: list[Document], tmp_path: Path
) -> None:
    shots = take_photos(tmp_path, "house", (0.0, 0.0, 2.0))
    with_photos = [
        {**station, "photos": [{"file": service.upload(path)["id"], **pose}]}
        for station, (path, pose) in zip(stations, shots, strict=True)
    ]
    result = run(
        service,
        "colour",
        {"stations": with_photos},
        {"coloured_cloud": {"format": "ply"}, "photos": {}, "coloured": {}},
    )
    assert [photo["station"] for photo in result["photos"]] == ["S1", "S2"]
    assert all(photo["shown"] > 1000 for photo in result["photos"])
    scan = downloaded(service, result["coloured_cloud"][0], tmp_path)
    assert int((scan.color > 0).any(axis=1).sum()) >= 0.99 * result["coloured"]
    low, high = SHIFT_M - np.array([6.0, 6.0, 1.0]), SHIFT_M + np.array([6.0, 6.0, 4.0])
    inputs = {
        "stations": with_photos,
        "cleaning": {"box": {"lowest_m": low.tolist(), "highest_m": high.tolist()}},
        "surface": {"resolution_m": 0.15, "max_gap_m": 0.2},
        "texture": {"size_px": 512},
        "contours": [{"station": "S1", "pixels": [[20.0, 20.0], [40.0, 30.0]]}],
    }
    meshed = run(service, "mesh", inputs, {"mesh": {"format": "obj"}, "texture": {}, "contours": {}})
    assert [file["name"] for file in meshed["mesh"]] == ["mesh.obj", "mesh.mtl", "mesh.jpg"]
    assert sum(meshed["texture"]["photos"].values()) == meshed["texture"]["textured_triangles"] > 100
    assert len(meshed["contours"][0]["points_m"]) == 2
    assert service.get(meshed["mesh"][2]["href"]).content[:2] == b"\xff\xd8"


def test_scans_without_photos_cannot_be_coloured(service: RunningService, stations: list[Document]) -> None:
    assert "no station has a photo" in str(refusal(service, "colour", {"stations": stations}))


def test_a_photo_without_mount_is_refused_at_its_place(
    service: RunningService, stations: list[Document], tmp_path: Path
) -> None:
    ((path, pose), _) = take_photos(tmp_path, "house", (0.0, 0.0, 2.0))
    photo = {"file": service.upload(path)["id"], "camera": pose["camera"]}
    problem = refusal(service, "colour", {"stations": [{**stations[0], "photos": [photo]}, stations[1]]})
    assert "/inputs/stations/0/photos/0" in str(problem)
