"""A photo goes in over HTTP; straight edges with honest standard deviations and a picture of them come out."""

import csv
import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.e2e.running.running_service import Document, RunningService

WIDTH, HEIGHT = 400, 300
CORNERS = np.array([[60.3, 40.6], [330.8, 71.2], [310.4, 250.7], [80.9, 230.1]])
NOISE = 2.0


def quadrilateral() -> np.ndarray:
    """A bright quadrilateral on dark ground, every pixel averaged over 8 by 8 samples, with noise."""
    at = (np.arange(8) + 0.5) / 8.0 - 0.5
    x = (np.arange(WIDTH)[:, None] + at).ravel()
    y = (np.arange(HEIGHT)[:, None] + at).ravel()
    inside = np.ones((len(y), len(x)), dtype=bool)
    for start, end in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        dx, dy = end - start
        inside &= dx * (y[:, None] - start[1]) - dy * (x[None, :] - start[0]) > 0.0
    share = inside.reshape(HEIGHT, 8, WIDTH, 8).mean(axis=(1, 3))
    grey = cv2.GaussianBlur(60.0 + 120.0 * share, (0, 0), 0.7)
    return np.rint(grey + np.random.default_rng(4).normal(0.0, NOISE, grey.shape)).clip(0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def photo(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Document:
    path = tmp_path_factory.mktemp("photo") / "quadrilateral.png"
    assert cv2.imwrite(str(path), quadrilateral())
    return service.upload(path)


@pytest.fixture(scope="module")
def result(service: RunningService, photo: Document) -> Document:
    return service.result(service.execute("detect-edges", {"photo": {"file": photo["id"]}}))


def test_the_uploaded_image_is_listed_as_a_photo_of_its_size(photo: Document) -> None:
    assert (photo["kind"], photo["format"]) == ("photo", "PNG")
    assert [(each["width"], each["height"]) for each in photo["photos"]] == [(WIDTH, HEIGHT)]


def test_the_four_sides_are_found_the_longest_first(result: Document) -> None:
    sides = np.linalg.norm(CORNERS - np.roll(CORNERS, -1, axis=0), axis=1)
    found = [edge["length_px"] for edge in result["edges"]]
    assert found == sorted(found, reverse=True)
    # the profile across the edge is disturbed within some pixels of a corner
    np.testing.assert_allclose(found, np.sort(sides)[::-1], atol=8.0)


def test_each_side_is_true_within_four_of_its_standard_deviations(result: Document) -> None:
    for edge in result["edges"]:
        centre, direction = np.array(edge["centre_px"]), np.array(edge["direction"])
        ends = [(a, b - a) for a, b in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True)]
        offsets = [float(d[0] * (a - centre)[1] - d[1] * (a - centre)[0]) / np.hypot(*d) for a, d in ends]
        angles = [abs(float(d[0] * direction[1] - d[1] * direction[0])) / np.hypot(*d) for _, d in ends]
        nearest = int(np.argmin(np.abs(offsets) + 100.0 * np.array(angles)))
        assert abs(offsets[nearest]) < 4.0 * edge["offset_std_px"] < 0.2
        assert np.arcsin(angles[nearest]) * 200.0 / np.pi < 4.0 * edge["angle_std_gon"] < 0.5


def test_the_picture_has_the_size_of_the_photo(service: RunningService, result: Document) -> None:
    (overlay,) = [each for each in result["artifacts"] if each["name"] == "overlay.png"]
    answer = service.http.get(overlay["href"])
    assert (answer.headers["content-type"], len(answer.content)) == ("image/png", overlay["bytes"])
    picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (HEIGHT, WIDTH, 3)


def test_the_table_has_a_row_for_every_edge(service: RunningService, result: Document) -> None:
    (table,) = [each for each in result["artifacts"] if each["name"] == "segments.csv"]
    rows = list(csv.DictReader(io.StringIO(service.http.get(table["href"]).text)))
    assert [float(row["length_px"]) for row in rows] == [edge["length_px"] for edge in result["edges"]]


def test_the_same_photo_gives_the_same_edges(service: RunningService, photo: Document, result: Document) -> None:
    again = service.result(service.execute("detect-edges", {"photo": {"file": photo["id"]}}))
    assert again["edges"] == result["edges"]


def test_lens_distortion_is_removed_from_the_edges(service: RunningService, photo: Document) -> None:
    camera = {"width": WIDTH, "height": HEIGHT, "fx": 400.0, "fy": 400.0, "cx": 200.0, "cy": 150.0, "k1": -0.05}
    answer = service.result(
        service.execute(
            "detect-edges", {"photo": {"file": photo["id"], "camera": camera}, "edges": {"max_segments": 3}}
        )
    )
    assert (len(answer["edges"]), answer["counts"]["truncated"]) == (3, True)
    edge = answer["edges"][0]
    # barrel distortion drew points inwards: without it they lie farther out
    centre = np.array([200.0, 150.0])
    assert np.linalg.norm(np.array(edge["start_px"]) - centre) > np.linalg.norm(np.array(edge["raw_start_px"]) - centre)


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


BOMB = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0))


@pytest.mark.parametrize(
    ("name", "content", "status", "why"),
    [
        ("empty.jpg", b"", 400, "empty"),
        ("cut.png", bytes(cv2.imencode(".png", quadrilateral())[1])[:9000], 400, "damaged or cut off"),
        ("cut.jpg", bytes(cv2.imencode(".jpg", quadrilateral())[1])[:9000], 400, "damaged or cut off"),
        ("bomb.png", BOMB + bytes(1000), 413, "2500000000 pixels"),
        ("text.jpg", b"this is no image", 400, "no JPEG, PNG or TIFF"),
        ("point.png", bytes(cv2.imencode(".png", np.zeros((1, 1), np.uint8))[1]), 400, "1 by 1 pixels"),
    ],
)
def test_an_image_that_cannot_be_used_is_refused_and_leaves_nothing(
    service: RunningService, name: str, content: bytes, status: int, why: str
) -> None:
    before = service.stored()
    answer = service.post("/files", files={"file": (name, content)})
    assert (answer.status_code, why in answer.json()["detail"]) == (status, True), answer.text
    assert service.stored() == before


def test_edges_of_a_photo_without_any_are_none(service: RunningService, tmp_path: Path) -> None:
    path = tmp_path / "grey.tif"
    assert cv2.imwrite(str(path), np.full((50, 60), 90, np.uint8))
    answer = service.result(service.execute("detect-edges", {"photo": {"file": service.upload(path)["id"]}}))
    assert (answer["edges"], answer["counts"]["median_offset_std_px"]) == ([], None)
