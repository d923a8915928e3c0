"""Large requests, and texts of other programs, are read in a process of their own, with the same answers."""

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from conftest import Client

from schemas.values.text_counts import MOST_LINES
from service.adapters.files.object_files import blob_store
from service.adapters.processes.child_process import ChildProcesses
from service.dependencies import Adapters
from service.settings import Settings
from tests.doubles.application import create_app

POINTS = "A 0 0 0\nB 100 0 0\nC 100 100 0\n"
JAG3D = {
    "format": "jag3d",
    "files": [
        {"type": "reference-points", "text": POINTS},
        {"type": "new-points", "text": "P 40 60 1\n"},
        {"type": "slope-distances", "text": "A P 72.118\nB P 84.858\nC P 72.118\nA P 72.119\n", "std": 0.003},
    ],
}


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ChildProcesses]:
    found = ChildProcesses(Settings(data_dir=tmp_path_factory.mktemp("readers")), blob_store)
    yield found
    found.close()


@pytest.fixture
def reading(settings: Settings, adapters: Adapters, readers: ChildProcesses) -> Client:
    return Client(create_app(settings, replace(adapters, requests=readers)))


def inputs_of(client: Client, answer: Any) -> Any:
    assert answer.status_code == 201, answer.text[:500]
    return client.get(f"/jobs/{answer.json()['jobID']}/inputs").json()


def test_a_network_as_text_becomes_the_same_job_as_where_it_is_read_at_once(client: Client, reading: Client) -> None:
    found, expected = (inputs_of(each, each.submit({"network": JAG3D}, "adjust")) for each in (reading, client))
    assert found == expected
    assert len(found["network"]["observations"]["distances"]) == 4


def test_what_is_wrong_in_a_text_is_said_as_where_it_is_read_at_once(client: Client, reading: Client) -> None:
    wrong = {**JAG3D, "files": [*JAG3D["files"], {"type": "directions", "text": "A P x\n", "std": 0.001}]}
    found, expected = (each.submit({"network": wrong}, "adjust") for each in (reading, client))
    assert found.status_code == expected.status_code == 400
    assert found.json()["errors"] == expected.json()["errors"]
    assert "directions, line 1" in found.text


def test_lines_are_counted_before_they_are_read(reading: Client) -> None:
    text = "A P 1\n" * (MOST_LINES + 1)
    network = {"format": "jag3d", "files": [{"type": "slope-distances", "text": text, "std": 0.003}]}
    answer = reading.submit({"network": network}, "adjust")
    assert answer.status_code == 400
    assert f"at most {MOST_LINES} are read" in answer.text


def test_a_large_request_finds_the_files_that_it_names(reading: Client) -> None:
    stations: list[dict[str, Any]] = [
        {"name": name, "scan": {"file": reading.upload(f"{name}.xyz")}} for name in ("A", "B")
    ]
    body = json.dumps({"inputs": {"stations": stations}}).encode() + b" " * 1_100_000
    answer = reading.post("/processes/register/execution", content=body)
    assert [each["scan"]["file"] for each in inputs_of(reading, answer)["stations"]] == [
        each["scan"]["file"] for each in stations
    ]
    stations[1]["scan"]["file"] = "nothing"
    body = json.dumps({"inputs": {"stations": stations}}).encode() + b" " * 1_100_000
    answer = reading.post("/processes/register/execution", content=body)
    assert answer.status_code == 400
    assert [each["pointer"] for each in answer.json()["errors"]] == ["/inputs/stations/1/scan/file"]


def test_a_large_request_takes_stations_of_a_job(reading: Client) -> None:
    stations = [{"name": name, "scan": {"file": reading.upload(f"{name}.xyz")}} for name in ("A", "B")]
    job = reading.submit({"stations": stations}).json()["jobID"]
    body = json.dumps({"inputs": {"stations": {"jobID": job}}}).encode() + b" " * 1_100_000
    answer = reading.post("/processes/transform/execution", content=body)
    assert answer.status_code == 400
    assert "accepted: it has no poses" in answer.text


def test_what_is_answered_at_once_may_not_be_large(reading: Client) -> None:
    body = json.dumps({"inputs": {"stringInput": "a"}}).encode() + b" " * 1_100_000
    assert reading.post("/processes/echo/execution", content=body).status_code == 413
    later = reading.post("/processes/echo/execution", content=body, headers={"Prefer": "respond-async"})
    assert inputs_of(reading, later) == {"stringInput": "a"}
