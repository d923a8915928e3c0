"""Photos of stations on the command line: a JSON list beside the scans."""

import json
from pathlib import Path
from typing import Any

import pytest

from service.errors import InvalidRequestError
from service.register_command import stations_with_photos
from service.use_cases.inputs.read_photo_list import PhotoList, read_photo_list

SCANS = [
    {"id": "1", "name": "north.ptx", "scans": [{"index": 0}], "photos": []},
    {"id": "2", "name": "south.e57", "scans": [{"index": 0}], "photos": []},
]
STORED = {"index": 0, "scan": 0, "refused": None, "camera": {}, "scan_from_camera": []}


def written(folder: Path, document: Any) -> Path:
    path = folder / "photos.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def with_photos(folder: Path, stations: list[dict[str, Any]]) -> PhotoList:
    for name in ("a/1.jpg", "b/1.jpg"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(name.encode())
    return read_photo_list(written(folder, {"stations": stations}), [Path("x/north.ptx"), Path("south.e57")])


def uploaded(identifier: str) -> dict[str, Any]:
    return {"id": identifier, "name": "1.jpg", "scans": [], "photos": [{"index": 0}]}


def test_photos_are_found_beside_the_list_and_uploaded_once(tmp_path: Path) -> None:
    photos = [{"file": "a/1.jpg"}, {"file": "b/1.jpg"}, {"file": "a/1.jpg", "index": 1}]
    assert with_photos(tmp_path, [{"photos": photos}]).paths == [tmp_path / "a/1.jpg", tmp_path / "b/1.jpg"]


def test_photos_of_the_same_name_keep_to_their_stations(tmp_path: Path) -> None:
    listed = with_photos(tmp_path, [{"photos": [{"file": "b/1.jpg"}]}, {"photos": [{"file": "a/1.jpg", "cop_gon": 1}]}])
    stations = stations_with_photos(listed, SCANS, [uploaded("B"), uploaded("A")])
    assert [station["name"] for station in stations] == ["north", "south"]
    assert [station["photos"] for station in stations] == [[{"file": "B"}], [{"file": "A", "cop_gon": 1}]]


def test_a_station_is_told_by_its_scan_and_may_be_named(tmp_path: Path) -> None:
    listed = with_photos(
        tmp_path, [{"name": "yard", "scan": {"file": "data/south.e57"}, "photos": [{"file": "a/1.jpg"}]}]
    )
    stations = stations_with_photos(listed, SCANS, [uploaded("A")])
    assert [(station["name"], station["scan"]["file"]) for station in stations] == [("yard", "2"), ("north", "1")]


def test_images_of_an_e57_file_are_used_without_a_list() -> None:
    scans = [SCANS[0], {**SCANS[1], "photos": [STORED, {**STORED, "index": 1, "refused": "broken"}]}]
    stations = stations_with_photos(PhotoList({}, []), scans, [])
    assert [station["photos"] for station in stations] == [[], [{"file": "2", "index": 0}]]


def test_images_of_an_e57_file_can_be_listed(tmp_path: Path) -> None:
    scans = [SCANS[0], {**SCANS[1], "photos": [STORED, {**STORED, "index": 1, "camera": None}]}]
    listed = with_photos(tmp_path, [{"scan": {"file": "south.e57"}, "photos": [{"file": "south.e57", "index": 1}]}])
    assert stations_with_photos(listed, scans, [])[0]["photos"] == [{"file": "2", "index": 1}]


@pytest.mark.parametrize(
    ("document", "what"),
    [
        ("{", "no valid JSON"),
        ("", "is empty"),
        ([], "an object with the member `stations`"),
        ({"stations": [{"photos": [{"file": "gone.jpg"}]}]}, "photos that are not there"),
    ],
)
def test_a_list_that_cannot_be_used_says_why(tmp_path: Path, document: Any, what: str) -> None:
    with pytest.raises(InvalidRequestError, match=what):
        read_photo_list(written(tmp_path, document), [])


def test_a_missing_photo_is_pointed_at(tmp_path: Path) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        with_photos(tmp_path, [{}, {"photos": [{"file": "a/1.jpg"}, {"file": "a/2.jpg"}]}])
    (fault,) = refused.value.faults
    assert fault.pointer == "/stations/1/photos/1/file"
    assert str(tmp_path / "a/2.jpg") in fault.detail


def test_a_scan_that_was_not_given_is_refused(tmp_path: Path) -> None:
    listed = with_photos(tmp_path, [{"scan": {"file": "west.ptx"}}])
    with pytest.raises(InvalidRequestError) as refused:
        stations_with_photos(listed, SCANS, [])
    assert "'north.ptx', 'south.e57'" in refused.value.faults[0].detail
