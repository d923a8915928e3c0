"""Registration in one request."""

import json
import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.ports import CallbackEvent, Subscription
from service.settings import Settings
from service.use_cases.access.sealed_secrets import seal_of
from tests.api.conftest import Client
from tests.doubles.application import create_app

Pointers = Callable[[httpx.Response], list[str]]
TWO = [("scan", ("a.xyz", b"1 2 3")), ("scan", ("b.xyz", b"4 5 6"))]


HEARING = {"successUri": "http://127.0.0.1:8080/told", "secret": "sixteen letters or more"}


def with_options(options: Any) -> list[tuple[str, Any]]:
    return [*TWO, ("options", (None, json.dumps(options)))]


def with_subscriber(subscriber: Any) -> list[tuple[str, Any]]:
    return [*TWO, ("subscriber", (None, json.dumps(subscriber)))]


def test_two_scans_become_a_job_of_two_stations(client: Client, adapters: Adapters) -> None:
    answer = client.post("/registrations", files=TWO)
    assert answer.status_code == 201
    assert answer.headers["location"].endswith(f"/jobs/{answer.json()['jobID']}")
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.process_id == "register"
    assert [station["name"] for station in job.inputs["stations"]] == ["a", "b"]
    assert client.get(f"/files/{job.file_ids[1]}").json()["name"] == "b.xyz"


def test_every_scan_of_a_file_becomes_a_station(client: Client, adapters: Adapters) -> None:
    answer = client.post("/registrations", files=[("scan", ("both.e57", b"scan scan"))])
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert [station["scan"]["index"] for station in job.inputs["stations"]] == [0, 1]


@pytest.mark.parametrize("wrapped", [True, False])
@pytest.mark.parametrize("first", [True, False])
def test_options_may_stand_anywhere_and_be_wrapped(
    client: Client, adapters: Adapters, wrapped: bool, first: bool
) -> None:
    options = {"method": {"method": "lines"}, "pairs": [["S2", "S1"]]}
    form = with_options({"inputs": options} if wrapped else options)
    answer = client.post("/registrations", files=form[::-1] if first else form)
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    assert job.inputs["method"]["method"] == "lines"
    # numbers of scans, in the order of the form, stand for the names of their files
    assert job.inputs["pairs"] == [["a", "b"] if first else ["b", "a"]]


def names_of(client: Client, adapters: Adapters, files: list[Any]) -> list[str]:
    answer = client.post("/registrations", files=files)
    assert answer.status_code == 201, answer.text
    job = adapters.jobs.get(answer.json()["jobID"])
    assert job is not None
    return [station["name"] for station in job.inputs["stations"]]


def test_stations_are_named_after_their_files_and_never_twice(client: Client, adapters: Adapters) -> None:
    files = [
        ("scan", (name, content))
        for name, content in (("yard.xyz", b"1 2 3"), ("yard.xyz", b"4 5 6"), ("both.e57", b"scan scan"))
    ]
    assert names_of(client, adapters, files) == ["yard", "yard (2)", "both-1", "both-2"]


@pytest.mark.parametrize(
    "hostile", ["=1+1.xyz", "@SUM(A1).xyz", "-2+3.xyz", "<b>x</b>.xyz", "..%2f..%2fx.xyz", 'a"b.xyz', "\u202egnp.xyz"]
)
def test_names_of_files_make_names_that_no_table_page_or_folder_mistakes(
    client: Client, adapters: Adapters, hostile: str
) -> None:
    for name in names_of(client, adapters, [("scan", (hostile, b"1 2 3")), TWO[1]]):
        assert re.fullmatch(r"\w[\w .()+-]*", name)


def test_a_file_called_like_a_number_keeps_its_name(client: Client, adapters: Adapters) -> None:
    form = [
        ("scan", ("S2.xyz", b"1 2 3")),
        ("scan", ("other.xyz", b"4 5 6")),
        ("options", (None, json.dumps({"pairs": [["S2", "other"]]}))),
    ]
    job = adapters.jobs.get(client.post("/registrations", files=form).json()["jobID"])
    assert job is not None
    assert job.inputs["pairs"] == [["S2", "other"]]


@pytest.mark.parametrize(
    ("form", "pointer"),
    [
        ([], "/scan"),
        (TWO[:1], "/scan"),
        ([*TWO, ("photo", ("p.jpg", b"x"))], "/photo"),
        ([*TWO, ("colour", (None, "red"))], "/colour"),
        ([*TWO, ("scan", (None, "no file"))], "/scan"),
        ([*TWO, ("options", (None, "{")), ("options", (None, "{}"))], "/options"),
        ([*TWO, ("options", (None, "{"))], "/options"),
        (with_options([]), "/options"),
        (with_options({"stations": []}), "/options/stations"),
        (with_options({"method": {"method": "magic"}}), "/options/method/method"),
        (with_options({"pairs": [["S1", "S9"]]}), "/options/pairs/0/1"),
        (with_options({"speed": 1}), "/options/speed"),
        (with_options({"inputs": {}, "speed": 1}), "/options/speed"),
        (with_options({"inputs": []}), "/options"),
        (with_options({"inputs": {"fix": 1}}), "/options/fix"),
        (with_options({"inputs": {}, "outputs": {"colour": {}}}), "/options/outputs/colour"),
        (with_options({"inputs": {}, "subscriber": {"failedUri": "ftp://a"}}), "/options/subscriber/failedUri"),
        (with_subscriber({"failedUri": "http://10.0.0.1/"}), "/subscriber/failedUri"),
        (with_subscriber({"everyUri": "http://10.0.0.1/"}), "/subscriber/everyUri"),
        (with_subscriber([]), "/subscriber"),
        ([*TWO, ("subscriber", (None, "{"))], "/subscriber"),
        ([*with_subscriber({}), ("subscriber", (None, "{}"))], "/subscriber"),
        ([*with_subscriber({}), *with_options({"inputs": {}, "subscriber": {}})[2:]], "/subscriber"),
        (with_options({"stations": [{f"{number}": 0 for number in range(1100)}]}), "/options"),
    ],
)
def test_a_bad_form_is_pointed_at_and_leaves_nothing_behind(
    client: Client, adapters: Adapters, pointers: Pointers, form: list[Any], pointer: str
) -> None:
    if form:
        answer = client.post("/registrations", files=form)
    else:
        answer = client.post(
            "/registrations", content=b"--X--\r\n", headers={"Content-Type": "multipart/form-data; boundary=X"}
        )
    assert pointers(answer) == [pointer]
    assert not adapters.blobs.keys("")
    assert client.get("/files").json()["files"] == []
    assert client.get("/jobs").json()["jobs"] == []


@pytest.mark.parametrize(
    "form", [with_subscriber(HEARING), with_options({"inputs": {}, "subscriber": HEARING})], ids=["field", "options"]
)
def test_the_job_tells_the_subscriber_of_the_form(settings: Settings, adapters: Adapters, form: list[Any]) -> None:
    settings = settings.model_copy(update={"allow_private_callbacks": True})
    client, seal = Client(create_app(settings, adapters)), seal_of(settings)
    job = adapters.jobs.get(client.post("/registrations", files=form).json()["jobID"])
    assert job is not None
    assert seal is not None
    assert job.subscriber is not None
    subscription = Subscription.from_json(job.subscriber)
    assert subscription.uris == {CallbackEvent.SUCCESS: HEARING["successUri"]}
    assert seal.opened(subscription.secret, job.owner) == HEARING["secret"]
    assert subscription.base_url == "http://tieline.test"


def test_options_may_ask_for_some_outputs(client: Client, adapters: Adapters) -> None:
    form = with_options({"inputs": {}, "outputs": {"pairs": {}}, "response": "raw"})
    job = adapters.jobs.get(client.post("/registrations", files=form).json()["jobID"])
    assert job is not None
    assert job.wanted == {"outputs": ["pairs"], "raw": True}


def test_an_unreadable_scan_leaves_nothing_behind(client: Client, adapters: Adapters) -> None:
    answer = client.post("/registrations", files=[TWO[0], ("scan", ("b.e57", b"broken"))])
    assert answer.status_code == 400
    assert answer.json()["file"] == "b.e57"
    assert not adapters.blobs.keys("")


def test_anything_but_a_form_is_refused(client: Client) -> None:
    assert client.post("/registrations", json={}).status_code == 415
