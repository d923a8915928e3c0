"""Photos over HTTP: uploads, and the process `detect-edges`."""

from collections.abc import Callable
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from tests.api.conftest import PHOTO, Client

Pointers = Callable[[httpx.Response], list[str]]
CAMERA = {"model": "brown", "width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}


@pytest.fixture
def photo(client: Client) -> dict[str, Any]:
    return {"file": client.upload("north.jpg", b"photo")}


def test_an_uploaded_image_is_a_photo(client: Client) -> None:
    document = client.get(f"/files/{client.upload('north.jpg', b'photo')}").json()
    assert (document["kind"], document["scans"]) == ("photo", [])
    assert document["photos"] == [PHOTO]


def test_edges_are_detected_in_one_photo(client: Client, adapters: Adapters, photo: dict[str, Any]) -> None:
    answer = client.submit({"photo": {**photo, "camera": CAMERA}}, "detect-edges")
    assert answer.status_code == 201
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.file_ids == (photo["file"],)
    assert job.inputs["photo"]["camera"]["k1"] == 0.0
    assert job.inputs["edges"]["min_length_px"] == 20.0


def test_a_photo_needs_no_camera_to_detect_edges(client: Client, photo: dict[str, Any]) -> None:
    assert client.submit({"photo": photo}, "detect-edges").status_code == 201


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"file": "unknown"}, "file"),
        ({"file": "../../etc/passwd"}, "file"),
        ({"index": 1}, "index"),
        ({"index": -1}, "index"),
        ({"index": "0"}, "index"),
        ({"scan_from_camera": None}, "scan_from_camera"),
        ({"camera": {**CAMERA, "width": 641}}, "camera/width"),
        ({"camera": {**CAMERA, "height": 481}}, "camera/height"),
        ({"camera": {**CAMERA, "fx": 0.0}}, "camera/fx"),
        ({"camera": {**CAMERA, "model": "fisheye"}}, "camera/model"),
        ({"camera": {**CAMERA, "k4": 0.1}}, "camera/k4"),
        ({"camera": {**CAMERA, "k1": -5.0}}, "camera"),
        ({"camera": {name: value for name, value in CAMERA.items() if name != "fy"}}, "camera/fy"),
    ],
)
def test_a_bad_field_of_a_photo_is_pointed_at(
    client: Client, photo: dict[str, Any], pointers: Pointers, change: dict[str, Any], pointer: str
) -> None:
    assert pointers(client.submit({"photo": {**photo, **change}}, "detect-edges")) == [f"/inputs/photo/{pointer}"]


@pytest.mark.parametrize(
    ("options", "pointer"),
    [
        ({"detector": "magic"}, "detector"),
        ({"min_length_px": 1.0}, "min_length_px"),
        ({"max_segments": 0}, "max_segments"),
        ({"speed": 1}, "speed"),
    ],
)
def test_a_bad_option_of_the_detection_is_pointed_at(
    client: Client, photo: dict[str, Any], pointers: Pointers, options: dict[str, Any], pointer: str
) -> None:
    answer = client.submit({"photo": photo, "edges": options}, "detect-edges")
    assert pointers(answer) == [f"/inputs/edges/{pointer}"]


def test_a_scan_is_no_photo(client: Client, pointers: Pointers) -> None:
    answer = client.submit({"photo": {"file": client.upload()}}, "detect-edges")
    assert pointers(answer) == ["/inputs/photo/file"]


def test_a_photo_is_no_scan(client: Client, photo: dict[str, Any], pointers: Pointers) -> None:
    answer = client.submit({"station": {"name": "A", "scan": photo}}, "extract-lines")
    assert pointers(answer) == ["/inputs/station/scan/file"]


def test_a_photo_in_use_cannot_be_removed_before_its_job_ends(client: Client, photo: dict[str, Any]) -> None:
    client.submit({"photo": photo}, "detect-edges")
    assert client.delete(f"/files/{photo['file']}").status_code == 409


def test_the_options_of_the_detection_are_described_with_bounds_and_units(client: Client) -> None:
    schema = client.get("/processes/detect-edges").json()["inputs"]["edges"]["schema"]["properties"]
    assert "[px]" in schema["min_length_px"]["description"]
    assert schema["min_length_px"]["minimum"] == 5.0


@pytest.fixture
def station(client: Client, photo: dict[str, Any]) -> dict[str, Any]:
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    return {
        "name": "A",
        "scan": {"file": client.upload("a.xyz")},
        "photos": [{**photo, "camera": CAMERA, "scan_from_camera": pose}],
    }


def test_a_registration_takes_scans_and_photos(
    client: Client, adapters: Adapters, station: dict[str, Any], photo: dict[str, Any]
) -> None:
    other = {"name": "B", "scan": {"file": client.upload("b.xyz")}}
    answer = client.submit({"stations": [station, other], "photo_lines": {"edges": {"min_contrast": 9.0}}})
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.file_ids == (station["scan"]["file"], photo["file"], other["scan"]["file"])
    assert job.inputs["stations"][0]["photos"][0]["mount_std"] == {"rotation_gon": 0.02, "translation_m": 0.003}
    assert job.inputs["photo_lines"]["edges"]["min_contrast"] == 9.0


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"index": 3}, "index"),
        ({"camera": None}, "camera"),
        ({"camera": {**CAMERA, "height": 640}}, "camera/height"),
        ({"scan_from_camera": None}, "scan_from_camera"),
        ({"scan_from_camera": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "scan_from_camera"),
        ({"scan_from_camera": None, "cop_gon": 100.0}, "mount"),
        ({"mount_std": {"rotation_gon": -0.1}}, "mount_std/rotation_gon"),
        ({"camera_axes": "sideways"}, "camera_axes"),
        ({"exposure": 1}, "exposure"),
    ],
)
@pytest.mark.parametrize("process", ["register", "extract-lines"])
def test_a_bad_field_of_a_photo_of_a_station_is_pointed_at(
    client: Client, station: dict[str, Any], pointers: Pointers, process: str, change: dict[str, Any], pointer: str
) -> None:
    wrong = {**station, "photos": [{**station["photos"][0], **change}]}
    other = {"name": "B", "scan": {"file": client.upload("b.xyz")}}
    inputs = {"station": wrong} if process == "extract-lines" else {"stations": [other, wrong]}
    where = "/inputs/station" if process == "extract-lines" else "/inputs/stations/1"
    found = pointers(client.submit(inputs, process))
    # a matrix of the wrong size is wrong in several places
    assert {each[: len(where) + len("/photos/0/") + len(pointer)] for each in found} == {f"{where}/photos/0/{pointer}"}
