"""Execution requests: what is accepted, what is refused and where the fault points."""

import json
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.settings import Settings
from service.use_cases.access.sealed_secrets import seal_of
from tests.api.conftest import Client
from tests.doubles.application import create_app

Pointers = Callable[[httpx.Response], list[str]]
IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.fixture
def inputs(client: Client) -> dict[str, Any]:
    return {
        "stations": [
            {"name": "A", "scan": {"file": client.upload("a.xyz"), "index": 0}},
            {"name": "B", "scan": {"file": client.upload("b.xyz")}},
        ]
    }


def test_a_registration_becomes_a_waiting_job(client: Client, inputs: dict[str, Any]) -> None:
    answer = client.submit(inputs)
    assert answer.status_code == 201
    assert answer.headers["location"] == f"http://tieline.test/jobs/{answer.json()['jobID']}"
    assert answer.json()["status"] == "accepted"


def test_stored_inputs_have_their_defaults_filled_in(
    client: Client, adapters: Adapters, inputs: dict[str, Any]
) -> None:
    job = adapters.jobs.get(client.submit(inputs).json()["jobID"])
    assert job is not None
    assert job.inputs["method"]["method"] == "auto"
    assert job.inputs["pairs"] == "auto"
    assert job.inputs["fix"] == "first-station"
    assert job.inputs["stations"][1]["scan"]["index"] == 0
    assert job.file_ids == tuple(station["scan"]["file"] for station in inputs["stations"])


def test_a_body_without_content_type_is_read_as_json(client: Client, inputs: dict[str, Any]) -> None:
    body = json.dumps({"inputs": inputs}).encode()
    answer = client.post("/processes/register/execution", content=body)
    assert "content-type" not in answer.request.headers
    assert answer.status_code == 201


def test_wishing_for_a_synchronous_registration_still_gives_a_job(client: Client, inputs: dict[str, Any]) -> None:
    answer = client.post("/processes/register/execution", json={"inputs": inputs}, headers={"Prefer": "respond-sync"})
    assert answer.status_code == 201


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"stations": None}, "/inputs/stations"),
        ({"surprise": 1}, "/inputs/surprise"),
        ({"fix": "last"}, "/inputs/fix"),
        ({"control": [{"name": "1", "x": 1, "y": 1, "z": 1}]}, "/inputs/control/0"),
        ({"method": {"method": "guess"}}, "/inputs/method/method"),
        ({"method": {}}, "/inputs/method/method"),
        ({"method": "lines"}, "/inputs/method"),
        ({"method": {"method": "lines", "speed": 3}}, "/inputs/method/speed"),
        ({"pairs": "some"}, "/inputs/pairs"),
        ({"pairs": []}, "/inputs/pairs"),
        ({"pairs": [["A"]]}, "/inputs/pairs/0/1"),
        ({"pairs": [["A", "C"]]}, "/inputs/pairs/0/1"),
        ({"pairs": [["A", "A"]]}, "/inputs/pairs/0"),
        ({"pairs": [["A", "B"], ["B", "A"]]}, "/inputs/pairs/1"),
        ({"reference": {"C": IDENTITY}}, "/inputs/reference/C"),
        ({"reference": {"A": IDENTITY[:3]}}, "/inputs/reference/A"),
        ({"reference": {"A": [*IDENTITY[:3], [0, 0, 1, 1]]}}, "/inputs/reference/A"),
        ({"reference": {"A": [[-1, 0, 0, 0], *IDENTITY[1:]]}}, "/inputs/reference/A"),
        ({"reference": {"A": [[2, 0, 0, 0], *IDENTITY[1:]]}}, "/inputs/reference/A"),
        ({"reference": {"A": [[1, 0, 0, 1e300], *IDENTITY[1:]]}}, "/inputs/reference/A"),
    ],
)
def test_a_bad_field_of_a_registration_is_pointed_at(
    client: Client, inputs: dict[str, Any], pointers: Pointers, change: dict[str, Any], pointer: str
) -> None:
    assert pointers(client.submit({**inputs, **change})) == [pointer]


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"name": ""}, "name"),
        ({"name": "../../etc"}, "name"),
        ({"name": 5}, "name"),
        ({"name": "A"}, "name"),
        ({"photos": [{"file": "x"}]}, "photos/0/file"),
        ({"photos": "x"}, "photos"),
        ({"levelled_std_gon": 0}, "levelled_std_gon"),
        ({"levelled_std_gon": -0.01}, "levelled_std_gon"),
        ({"levelled_std_gon": 50}, "levelled_std_gon"),
        ({"levelled_std_gon": True}, "levelled_std_gon"),
        ({"approximate_pose": "here"}, "approximate_pose"),
        ({"approximate_pose": IDENTITY[:3]}, "approximate_pose"),
        ({"approximate_pose": [[-1, 0, 0, 0], *IDENTITY[1:]]}, "approximate_pose"),
        ({"approximate_pose": [[2, 0, 0, 0], *IDENTITY[1:]]}, "approximate_pose"),
        ({"approximate_pose": {}}, "approximate_pose/matrix"),
        ({"approximate_pose": {"matrix": IDENTITY, "std": {"tx_m": 0}}}, "approximate_pose/std/tx_m"),
        ({"approximate_pose": {"matrix": IDENTITY, "std": {"tx_m": 1e300}}}, "approximate_pose/std/tx_m"),
        ({"approximate_pose": {"matrix": IDENTITY, "std": {"kappa_gon": -1}}}, "approximate_pose/std/kappa_gon"),
        ({"approximate_pose": {"matrix": IDENTITY, "covariance": []}}, "approximate_pose/covariance"),
        ({"point_std_m": -0.003}, "point_std_m"),
        ({"point_std_m": 0}, "point_std_m"),
        ({"point_std_m": "3"}, "point_std_m"),
        ({"point_std_m": 1e300}, "point_std_m"),
        ({"scan": {}}, "scan/file"),
        ({"scan": {"file": "unknown"}}, "scan/file"),
        ({"scan": {"file": "../../etc/passwd"}}, "scan/file"),
        ({"scan": None}, "scan"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_bad_field_of_a_station_is_pointed_at(
    client: Client, inputs: dict[str, Any], pointers: Pointers, change: dict[str, Any], pointer: str
) -> None:
    inputs["stations"][1] = {**inputs["stations"][1], **change}
    assert pointers(client.submit(inputs)) == [f"/inputs/stations/1/{pointer}"]


def test_what_is_known_of_a_station_reaches_the_job(client: Client, adapters: Adapters, inputs: dict[str, Any]) -> None:
    known = {
        "levelled_std_gon": 0.005,
        "approximate_pose": {"matrix": IDENTITY, "std": {"tx_m": 2.0}},
        "point_std_m": 0.003,
    }
    inputs["stations"][1] = {**inputs["stations"][1], **known}
    job = adapters.jobs.get(client.submit(inputs).json()["jobID"])
    assert job is not None
    station = job.inputs["stations"][1]
    assert (station["levelled_std_gon"], station["point_std_m"]) == (0.005, 0.003)
    assert station["approximate_pose"]["std"]["tx_m"] == 2.0
    assert station["approximate_pose"]["std"]["kappa_gon"] == 20.0


@pytest.mark.parametrize("index", [1, -1, "0", 0.5, 10**30])
def test_a_scan_that_a_file_does_not_have_is_pointed_at(
    client: Client, inputs: dict[str, Any], pointers: Pointers, index: Any
) -> None:
    inputs["stations"][0]["scan"]["index"] = index
    assert pointers(client.submit(inputs)) == ["/inputs/stations/0/scan/index"]


def test_all_bad_fields_are_listed_at_once(client: Client, pointers: Pointers) -> None:
    stations = [{"name": "A", "scan": {"file": "nix"}}, {"name": "A", "scan": {"file": "nix"}}]
    assert pointers(client.submit({"stations": stations})) == [
        "/inputs/stations/0/scan/file",
        "/inputs/stations/1/name",
        "/inputs/stations/1/scan/file",
    ]


def test_one_station_is_too_few(client: Client, inputs: dict[str, Any], pointers: Pointers) -> None:
    assert pointers(client.submit({"stations": inputs["stations"][:1]})) == ["/inputs/stations"]


def test_more_stations_than_the_limit_are_refused(client: Client, inputs: dict[str, Any], pointers: Pointers) -> None:
    stations = [{**inputs["stations"][0], "name": f"S{number}"} for number in range(5)]
    assert pointers(client.submit({"stations": stations})) == ["/inputs/stations"]


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"outputs": {"colour": {}}}, "/outputs/colour"),
        ({"outputs": {"pairs": {"transmissionMode": "reference"}}}, "/outputs/pairs/transmissionMode"),
        ({"response": "carrier pigeon"}, "/response"),
        ({"subscriber": {"successUri": "http://10.0.0.1/"}}, "/subscriber/successUri"),
        ({"extra": 1}, "/extra"),
    ],
)
def test_a_bad_field_beside_the_inputs_is_pointed_at(
    client: Client, inputs: dict[str, Any], pointers: Pointers, change: dict[str, Any], pointer: str
) -> None:
    assert pointers(client.post("/processes/register/execution", json={"inputs": inputs, **change})) == [pointer]


SUBSCRIBED = {"subscriber": {"successUri": "http://127.0.0.1:8080/", "secret": "a secret of the subscriber"}}


def test_the_secret_of_a_subscriber_is_not_kept_as_it_came(
    settings: Settings, adapters: Adapters, inputs: dict[str, Any]
) -> None:
    allowing = settings.model_copy(update={"allow_private_callbacks": True})
    client = Client(create_app(allowing, adapters))
    answer = client.post("/processes/register/execution", json={"inputs": inputs, **SUBSCRIBED})
    job = adapters.jobs.get(answer.json()["jobID"])
    seal = seal_of(allowing)
    assert job is not None
    assert job.subscriber is not None
    assert seal is not None
    assert "a secret of the subscriber" not in repr(job)
    assert seal.opened(job.subscriber["secret"], job.owner) == "a secret of the subscriber"


def test_a_secret_that_could_only_be_kept_in_the_clear_is_refused(
    settings: Settings, adapters: Adapters, inputs: dict[str, Any], pointers: Pointers
) -> None:
    shared = {"allow_private_callbacks": True, "database_url": "postgresql://tieline@nowhere/x", "callback_secret": ""}
    client = Client(create_app(settings.model_copy(update=shared), adapters))
    answer = client.post("/processes/register/execution", json={"inputs": inputs, **SUBSCRIBED})
    assert pointers(answer) == ["/subscriber/secret"]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"   ",
        b"{",
        b"[]",
        b"null",
        b"7",
        b'"text"',
        b"\xff\xfe\x00",
        b'{"inputs": NaN}',
        b'{"inputs": {"stations": 1e999}}',
        b'{"inputs": {"stations": "\\ud800"}}',
        b'{"inputs": ' + b"[" * 5000 + b"]" * 5000 + b"}",
        b'{"inputs": ' + b"9" * 6000 + b"}",
    ],
    ids=range(13),
)
@pytest.mark.parametrize("process", ["register", "extract-lines", "detect-edges", "echo"])
def test_a_body_that_is_no_request_is_refused_with_a_reason(
    client: Client, pointers: Pointers, body: bytes, process: str
) -> None:
    assert pointers(client.post(f"/processes/{process}/execution", content=body))


def test_malformed_json_tells_line_and_column(client: Client) -> None:
    answer = client.post("/processes/echo/execution", content=b'{"inputs":\n {,}}')
    assert "line 2 column 3" in answer.json()["detail"]


def test_an_overlong_body_is_refused(client: Client) -> None:
    answer = client.post("/processes/echo/execution", content=b" " * 10_000_001)
    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"


def test_too_many_waiting_jobs_are_refused(settings: Settings, adapters: Adapters) -> None:
    busy = Client(create_app(settings.model_copy(update={"max_queued_jobs": 1}), adapters))
    busy.register_two()
    answer = busy.post(
        "/processes/echo/execution", json={"inputs": {"stringInput": "x"}}, headers={"Prefer": "respond-async"}
    )
    assert answer.status_code == 429


def test_a_refused_request_leaves_no_job(client: Client) -> None:
    answer = client.submit({"stations": []})
    assert answer.status_code == 400
    assert client.get("/jobs").json()["numberMatched"] == 0


def test_lines_are_extracted_from_one_station(client: Client, adapters: Adapters) -> None:
    station = {"name": "A", "scan": {"file": client.upload()}}
    job = adapters.jobs.get(client.submit({"station": station}, "extract-lines").json()["jobID"])
    assert job is not None
    assert job.inputs["station"]["name"] == "A"
    assert job.inputs["features"]["min_plane_points"] == 30


def test_options_out_of_bounds_are_pointed_at(client: Client, pointers: Pointers) -> None:
    station = {"name": "A", "scan": {"file": client.upload()}}
    answer = client.submit({"station": station, "features": {"min_plane_points": 1, "magic": 2}}, "extract-lines")
    assert pointers(answer) == ["/inputs/features/magic", "/inputs/features/min_plane_points"]


def test_one_file_is_not_two_stations(client: Client, pointers: Pointers) -> None:
    file = client.upload("a.xyz", b"scan scan")
    stations = [{"name": name, "scan": {"file": file, "index": index}} for name, index in (("A", 1), ("B", 1))]
    answer = client.submit({"stations": stations})
    assert answer.status_code == 400
    assert pointers(answer) == ["/inputs/stations/0/scan", "/inputs/stations/1/scan"]
    assert "same measurement as that of station 'B'" in answer.json()["errors"][0]["detail"]


def test_a_content_that_was_sent_twice_is_not_two_stations(client: Client, pointers: Pointers) -> None:
    files = [client.upload(name, b"scan") for name in ("a.xyz", "b.xyz")]
    names = ("A", "B", "C")
    scans = [*files, client.upload("c.xyz", b"another scan")]
    answer = client.submit(
        {"stations": [{"name": name, "scan": {"file": file}} for name, file in zip(names, scans, strict=True)]}
    )
    assert answer.status_code == 400
    assert pointers(answer) == ["/inputs/stations/0/scan", "/inputs/stations/1/scan"]


def test_two_scans_of_one_file_are_two_stations(client: Client) -> None:
    file = client.upload("a.e57", b"scan scan")
    stations = [{"name": name, "scan": {"file": file, "index": index}} for name, index in (("A", 0), ("B", 1))]
    assert client.submit({"stations": stations}).status_code == 201
