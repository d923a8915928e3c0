"""A scan and a photo taken there go in over HTTP; lines that only the photo shows come out in space."""

from typing import Any

import cv2
import numpy as np
import pytest

from algorithms.geometry.lines import lines_from_arrays
from service.formats.photo import camera_document
from service.formats.writers import write_scans
from tests.e2e.running.running_service import Document, RunningService
from tests.scenes.photos.photo_scenes import line_errors, normalised_errors
from tests.scenes.photos.photo_wall import CAMERA, SCAN_FROM_CAMERA, nearest_side, true_sides, wall_photo, wall_scan

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def station(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("wall")
    write_scans(folder / "wall.e57", [wall_scan()])
    assert cv2.imwrite(str(folder / "wall.png"), wall_photo())
    photo = {
        "file": service.upload(folder / "wall.png")["id"],
        "camera": camera_document(CAMERA),
        "scan_from_camera": SCAN_FROM_CAMERA.as_matrix().tolist(),
        "mount_std": {"rotation_gon": 0.001, "translation_m": 0.0001},
    }
    return {"name": "yard", "scan": {"file": service.upload(folder / "wall.e57")["id"]}, "photos": [photo]}


@pytest.fixture(scope="module")
def result(service: RunningService, station: dict[str, Any]) -> Document:
    return service.result(service.execute("extract-lines", {"station": station}))


def test_the_scan_alone_shows_no_line(service: RunningService, station: dict[str, Any]) -> None:
    alone = {"name": station["name"], "scan": station["scan"]}
    assert service.result(service.execute("extract-lines", {"station": alone}))["lines"] == []


def test_the_sides_of_a_painted_rectangle_are_lines_of_the_photo(result: Document) -> None:
    assert {(line["source"], line["photo"], line["surface"]) for line in result["lines"]} == {
        ("photo-edge", 0, "surface-edge")
    }
    sides = {nearest_side(np.array(line["anchor_m"]), np.array(line["direction"])) for line in result["lines"]}
    assert sides == {0, 1, 2, 3}


def test_the_lines_are_true_within_their_covariance(result: Document) -> None:
    anchors, directions, covariances, bases = (
        np.array([line[name] for line in result["lines"]]) for name in ("anchor_m", "direction", "covariance", "basis")
    )
    lines = lines_from_arrays(
        anchors, directions, covariances, np.zeros((len(anchors), 2)), bases=np.swapaxes(bases, 1, 2)
    )
    sides = [nearest_side(anchor, direction) for anchor, direction in zip(anchors, directions, strict=True)]
    starts, ends = true_sides()
    # chi-square with four degrees of freedom: 23.5 is exceeded once in ten thousand
    assert normalised_errors(lines, line_errors(lines, starts[sides], ends[sides])).max() < 23.5


def test_what_became_of_every_edge_is_counted(result: Document) -> None:
    (counts,) = result["features"]["photos"]
    assert counts["segments"] == counts["projected"] + sum(counts["rejected"].values())
    assert result["features"]["photo_edges"] == len(result["lines"])


def test_one_wall_says_nothing_of_the_mount(result: Document) -> None:
    test = result["mount_test"]
    assert (test["degrees_of_freedom"], test["passed"], test["text"]) == (0, None, None)
    assert "nothing could be tested" in test["reason"]
    assert [(each["photo"], each["lines"]) for each in test["photos"]] == [(0, 0)]


def test_scan_and_photo_are_named_as_inputs(result: Document, station: dict[str, Any]) -> None:
    files = [(each["kind"], each["file"]) for each in result["provenance"]["inputs"]]
    assert files == [("scan", station["scan"]["file"]), ("photo", station["photos"][0]["file"])]


def test_a_picture_shows_the_lines_in_the_photo(service: RunningService, result: Document) -> None:
    drawing, artifact = result["artifacts"]
    assert drawing["name"] == "lines.dxf"
    answer = service.http.get(artifact["href"])
    picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
    assert (artifact["name"], picture.shape) == ("photo-1.png", (CAMERA.height, CAMERA.width, 3))


def test_another_job_takes_the_stored_lines(service: RunningService, station: dict[str, Any], result: Document) -> None:
    again = service.result(service.execute("extract-lines", {"station": station}))
    assert again["lines"] == result["lines"]
    assert again["provenance"]["timings_s"]["features"] == 0.0


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"camera": None}, "camera"),
        ({"camera": {**camera_document(CAMERA), "width": 641}}, "camera/width"),
        ({"scan_from_camera": None}, "scan_from_camera"),
        ({"scan_from_camera": np.diag([1.0, 1.0, 1.01, 1.0]).tolist()}, "scan_from_camera"),
        ({"scan_from_camera": None, "mount": np.eye(4).tolist()}, "cop"),
        ({"mount_std": {"rotation_gon": 0.0}}, "mount_std/rotation_gon"),
    ],
)
def test_a_photo_without_what_it_needs_is_pointed_at(
    service: RunningService, station: dict[str, Any], change: dict[str, Any], pointer: str
) -> None:
    wrong = {**station, "photos": [{**station["photos"][0], **change}]}
    answer = service.post("/processes/extract-lines/execution", json={"inputs": {"station": wrong}})
    assert answer.status_code == 400
    assert [fault["pointer"] for fault in answer.json()["errors"]] == [f"/inputs/station/photos/0/{pointer}"]


def test_a_wall_without_edges_of_planes_leaves_the_mount_undetermined_and_says_what_to_add(
    service: RunningService, station: dict[str, Any]
) -> None:
    job = service.execute("calibrate-mount", {"stations": [station]})
    found = service.result(job)
    (mount,) = found["mounts"]
    assert mount["status"] == "undetermined"
    assert "photograph edges" in mount["text"]
    assert found["remarks"] == ["yard: the scan has no edge where two planes meet"]
    (listed,) = service.get(found["artifacts"][0]["href"]).json()["stations"]
    assert listed["photos"][0]["file"] == "wall.png"
