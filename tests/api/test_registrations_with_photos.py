"""Scans and photos in one form: which photo belongs to which station."""

import json
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from schemas.requests.register_inputs import MAX_PHOTOS
from service.dependencies import Adapters
from tests.api.conftest import CAMERA, POSE, Client

Pointers = Callable[[httpx.Response], list[str]]
Form = list[tuple[str, Any]]
TWO: Form = [("scan", ("a.xyz", b"1 2 3")), ("scan", ("b.xyz", b"4 5 6"))]
PHOTOS: Form = [("photo", ("a.jpg", b"photo")), ("photo", ("b.jpg", b"photo"))]
KNOWN = {"camera": CAMERA, "scan_from_camera": POSE}


def form_of(stations: Any, files: Form) -> Form:
    return [*files, ("options", (None, json.dumps({"stations": stations})))]


def registered(client: Client, adapters: Adapters, form: Form) -> list[dict[str, Any]]:
    """Register and give the stations of the job, with names in the place of identifiers."""
    answer = client.post("/registrations", files=form)
    assert answer.status_code == 201, answer.text
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    names = {identifier: client.get(f"/files/{identifier}").json()["name"] for identifier in job.file_ids}
    return [
        {
            "name": station["name"],
            "scan": (names[station["scan"]["file"]], station["scan"]["index"]),
            "photos": [(names[photo["file"]], photo["index"]) for photo in station["photos"]],
        }
        for station in job.inputs["stations"]
    ]


def test_photos_are_assigned_by_the_names_of_files(client: Client, adapters: Adapters) -> None:
    stations = [
        {"name": "north", "scan": {"file": "b.xyz"}, "photos": [{"file": "b.jpg", **KNOWN}]},
        {"name": "south", "scan": {"file": "a.xyz"}, "photos": [{"file": "a.jpg", **KNOWN}]},
    ]
    assert registered(client, adapters, form_of(stations, [*TWO, *PHOTOS])) == [
        {"name": "north", "scan": ("b.xyz", 0), "photos": [("b.jpg", 0)]},
        {"name": "south", "scan": ("a.xyz", 0), "photos": [("a.jpg", 0)]},
    ]


def test_without_names_scans_and_photos_are_taken_in_their_order(client: Client, adapters: Adapters) -> None:
    stations = [{"photos": [KNOWN]}, {"photos": [KNOWN]}]
    # the two photos of one camera may well have the same name
    photos = [("photo", ("1.jpg", b"photo"))] * 2
    found = registered(client, adapters, form_of(stations, [*photos, *TWO]))
    assert [(station["name"], station["scan"][0]) for station in found] == [("a", "a.xyz"), ("b", "b.xyz")]
    assert [station["photos"] for station in found] == [[("1.jpg", 0)]] * 2


def test_scans_that_are_not_listed_are_stations_without_photos(client: Client, adapters: Adapters) -> None:
    stations = [{"scan": {"file": "b.xyz"}, "photos": [{"file": "a.jpg", **KNOWN}]}]
    assert registered(client, adapters, form_of(stations, [*TWO, PHOTOS[0]])) == [
        {"name": "b", "scan": ("b.xyz", 0), "photos": [("a.jpg", 0)]},
        {"name": "a", "scan": ("a.xyz", 0), "photos": []},
    ]


@pytest.mark.parametrize("name", ["b", "S2"])
def test_a_station_may_be_told_by_the_name_or_the_number_of_its_scan(
    client: Client, adapters: Adapters, name: str
) -> None:
    stations = [{"name": name, "photos": [{"file": "a.jpg", **KNOWN}]}, {"name": "yard"}]
    assert registered(client, adapters, form_of(stations, [*TWO, PHOTOS[0]])) == [
        {"name": name, "scan": ("b.xyz", 0), "photos": [("a.jpg", 0)]},
        {"name": "yard", "scan": ("a.xyz", 0), "photos": []},
    ]


def test_photos_in_the_file_of_a_scan_need_no_mention(client: Client, adapters: Adapters) -> None:
    # the first photo of the file has neither camera nor pose and is left out
    form = [("scan", ("both.e57", b"scan scan photo posed posed"))]
    found = registered(client, adapters, form)
    assert [station["photos"] for station in found] == [[("both.e57", 1)], [("both.e57", 2)]]


def test_photos_in_the_file_of_a_scan_can_be_left_out_or_chosen(client: Client, adapters: Adapters) -> None:
    form = [("scan", ("both.e57", b"scan scan photo posed posed"))]
    stations = [{"photos": []}, {"scan": {"index": 1}, "photos": [{"file": "both.e57", "index": 0, **KNOWN}]}]
    found = registered(client, adapters, form_of(stations, form))
    assert [station["photos"] for station in found] == [[], [("both.e57", 0)]]


def test_hundreds_of_photos_in_the_file_of_a_scan_are_used_only_if_listed(client: Client, adapters: Adapters) -> None:
    many = b"scan " + b"posed " * (MAX_PHOTOS + 1)
    assert registered(client, adapters, [("scan", ("way.e57", many)), TWO[0]])[0]["photos"] == []


def test_a_photo_keeps_what_the_options_say_of_it(client: Client, adapters: Adapters) -> None:
    mount = {"mount": POSE, "cop_gon": 50.0, "mount_std": {"rotation_gon": 0.01}}
    stations = [{"photos": [{"file": "a.jpg", "camera": CAMERA, **mount}]}]
    answer = client.post("/registrations", files=form_of(stations, [*TWO, PHOTOS[0]]))
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    (photo,) = job.inputs["stations"][0]["photos"]
    assert (photo["cop_gon"], photo["mount_std"]["rotation_gon"]) == (50.0, 0.01)


GOOD = [{"photos": [{"file": "a.jpg", **KNOWN}]}, {"photos": [{"file": "b.jpg", **KNOWN}]}]
FIRST = "/options/stations/0"


@pytest.mark.parametrize(
    ("stations", "files", "expected"),
    [
        (None, [*TWO, *PHOTOS], ["/photo"]),
        (GOOD[:1], [*TWO, *PHOTOS], ["/photo"]),
        (GOOD, [*TWO, PHOTOS[0]], ["/options/stations/1/photos/0/file"]),
        ([{"photos": [KNOWN, KNOWN]}], [*TWO, PHOTOS[0]], [f"{FIRST}/photos/1"]),
        ([{}, {}, {}], TWO, ["/options/stations/2"]),
        ([{"scan": {"file": "c.xyz"}}], TWO, [f"{FIRST}/scan/file"]),
        ([{"scan": {}}], TWO, [f"{FIRST}/scan/file"]),
        ([{"scan": {"file": "a.xyz", "index": 1}}], TWO, [f"{FIRST}/scan/index"]),
        ([{"scan": {"file": "a.xyz"}}] * 2, TWO, ["/options/stations/1/scan"]),
        ([{"photos": [{"file": "1.jpg"}]}], [*TWO, *[("photo", ("1.jpg", b"photo"))] * 2], [f"{FIRST}/photos/0/file"]),
        ([{"photos": [{"file": "a.jpg"}]}], [*TWO, PHOTOS[0]], [f"{FIRST}/photos/0/{k}" for k in KNOWN]),
        ([{"photos": [{"file": "a.jpg", **KNOWN, "index": 1}]}], [*TWO, PHOTOS[0]], [f"{FIRST}/photos/0/index"]),
        ([{"photos": [{"file": 7, **KNOWN}]}], TWO, [f"{FIRST}/photos/0/file"]),
        ([{"photos": "a.jpg"}], TWO, [f"{FIRST}/photos"]),
        ([{"photos": ["a.jpg"]}], TWO, [f"{FIRST}/photos/0"]),
        ([{"scan": "a.xyz"}], TWO, [f"{FIRST}/scan"]),
        ([{"scan": {"file": "a.xyz", "colour": 1}}], TWO, [f"{FIRST}/scan/colour"]),
        ([{"name": ""}], TWO, [f"{FIRST}/name"]),
        ([{"name": "S2"}] * 2, TWO, ["/options/stations/1/name"]),
        ([{"name": "b", "scan": {"file": "a.xyz"}}], TWO, ["/scan"]),
        (["S1"], TWO, ["/options/stations"]),
        ({}, TWO, ["/options/stations"]),
        (GOOD[:1], [*TWO, ("photo", ("a.jpg", b"1 2 3"))], ["/photo"]),
        (None, [*TWO, ("scan", ("a.jpg", b"photo"))], ["/scan"]),
    ],
)
def test_what_belongs_to_no_station_is_pointed_at_and_leaves_nothing_behind(
    client: Client, adapters: Adapters, pointers: Pointers, stations: Any, files: Form, expected: list[str]
) -> None:
    form = files if stations is None else form_of(stations, files)
    assert sorted(set(pointers(client.post("/registrations", files=form)))) == sorted(set(expected))
    assert not adapters.blobs.keys("")
    assert client.get("/files").json()["files"] == []
    assert client.get("/jobs").json()["jobs"] == []


def test_a_photo_that_belongs_to_no_station_is_told_what_to_do(client: Client) -> None:
    problem = client.post("/registrations", files=[*TWO, PHOTOS[0]]).json()
    (fault,) = problem["errors"]
    assert "'a.jpg' belongs to no station" in fault["detail"]
    assert "scan_from_camera" in fault["detail"]
