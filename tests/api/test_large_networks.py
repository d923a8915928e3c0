"""Results of large networks over HTTP: pages and streams together are the document that a smaller network has."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest

from algorithms.progress import NoProgress
from schemas.results.registration_result import RegistrationDocument
from service.dependencies import Adapters
from service.names.content_keys import content_key
from service.names.result_lists import POINTERS, ROWS, rows_key
from service.ports import Job, JobStatus, Json, StepContext
from service.settings import Settings
from service.use_cases.jobs import find_rows
from service.use_cases.steps.job_poses import result_with_stations
from service.use_cases.steps.registered_calls import registered_calls
from service.use_cases.steps.registered_files import write_registered
from service.use_cases.steps.run_network import adjust_network
from service.use_cases.steps.run_registration_report import list_registered, report_registration
from tests.api.conftest import Client
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore
from tests.scenes.buildings.city_block import city_block
from tests.scenes.buildings.stored_networks import JOB, Templates, adjusting, neighbours, store_network
from tests.unit.service.use_cases.documents.test_pair_documents import MIXED, adjusted
from tests.unit.service.use_cases.steps.test_feature_store import some_features
from tests.unit.service.use_cases.steps.test_registration_report import two_lines

NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
STATIONS = 30
"""Their pairs take more than one blob of rows."""
REFERENCE = {"S1": {"matrix": np.eye(4).tolist()}}


@dataclass(frozen=True)
class Reported:
    """The same network reported twice."""

    whole: Json
    """The document of a small one."""
    scene: Json
    """What its viewer shows."""
    lines: bytes
    """The drawing of its lines."""
    blobs: MemoryBlobStore
    """What is stored of it as of a large one."""


@pytest.fixture(scope="module")
def city() -> Reported:
    blobs = MemoryBlobStore()
    block = city_block(STATIONS, np.random.default_rng(5))
    templates = Templates(replace(some_features(), lines=two_lines()), adjusted(MIXED))
    arguments = store_network(
        blobs, block, neighbours(block, 3), templates, surface_points=100, rng=np.random.default_rng(6)
    )
    arguments |= adjust_network(StepContext(blobs, NoProgress()), adjusting(arguments))
    arguments["inputs"] |= {"tolerance": {"std_m": 0.005}, "reference": REFERENCE}
    stored = []
    for most_whole in (STATIONS, STATIONS - 1):
        report_registration(StepContext(blobs, NoProgress(), {"max_whole_stations": most_whole}), arguments)
        lines = blobs.local_path(f"jobs/{JOB}/artifacts/lines.ply").read_bytes()
        stored.append([*(read(blobs, f"jobs/{JOB}/{name}.json") for name in ("result", "scene")), lines])
    return Reported(*stored[0], blobs)


def read(blobs: MemoryBlobStore, key: str) -> Json:
    document: Json = json.loads(blobs.local_path(key).read_bytes())
    return document


@pytest.fixture
def client(settings: Settings, adapters: Adapters, city: Reported) -> Client:
    finish(adapters, Job(JOB, "register", {}, JobStatus.ACCEPTED, NOW, updated=NOW))
    return Client(create_app(settings, replace(adapters, blobs=city.blobs)))


def finish(adapters: Adapters, job: Job) -> None:
    """Keep a job that has succeeded."""
    adapters.jobs.create_and_enqueue(job)
    adapters.jobs.start(job.id, NOW)
    adapters.jobs.succeed(job.id, NOW)


def put(document: Json, name: str, entries: list[Any]) -> None:
    """Put a list in its place."""
    *way, last = POINTERS[name]
    place = document
    for member in way:
        place = place[member]
    assert last not in place
    place[last] = entries


def paged(client: Client, address: str) -> Iterator[Any]:
    """Follow the links from page to page."""
    following: str | None = address
    while following is not None:
        page = client.get(following).json()
        assert page["numberReturned"] == len(page["entries"])
        yield from page["entries"]
        following = next((link["href"] for link in page["links"] if link["rel"] == "next"), None)


def comparable(document: Json) -> Json:
    """Leave out what is another: other downloads."""
    return {name: value for name, value in document.items() if name not in {"artifacts", "lists", "counts"}}


def test_pages_put_in_their_places_are_the_document_of_a_smaller_network(client: Client, city: Reported) -> None:
    document = client.get(f"/jobs/{JOB}/results").json()
    for name, each in document["lists"].items():
        entries = list(paged(client, f"{each['href']}?limit=17"))
        assert len(entries) == each["count"]
        put(document, name, entries)
    assert comparable(document) == comparable(city.whole)
    assert len(document["pairs"]) > ROWS
    RegistrationDocument.model_validate(document)


def test_streams_put_in_their_places_are_the_document_of_a_smaller_network(client: Client, city: Reported) -> None:
    document = client.get(f"/jobs/{JOB}/results").json()
    for name, each in document["lists"].items():
        answer = client.get(each["stream"])
        assert answer.headers["content-type"] == "application/x-ndjson"
        put(document, name, [json.loads(row) for row in answer.text.splitlines()])
    assert comparable(document) == comparable(city.whole)


def test_a_client_that_takes_lines_only_gets_the_stream(client: Client) -> None:
    address = f"/jobs/{JOB}/results/stations"
    asked = client.get(address, headers={"Accept": "application/x-ndjson"})
    assert asked.text == client.get(f"{address}.ndjson").text


def test_the_document_of_a_large_network_is_short_and_its_counts_are_those_of_the_lists(
    client: Client, city: Reported
) -> None:
    answer = client.get(f"/jobs/{JOB}/results")
    assert len(answer.content) < 20_000
    counts, whole = answer.json()["counts"], city.whole
    assert counts["frame"] == "S0"
    assert sum(counts["stations"].values()) == STATIONS
    assert counts["pairs"]["rejected"] == sum(pair["status"] == "rejected" for pair in whole["pairs"]) > 0
    assert counts["loops"] == len(whole["network"]["loops"])


def test_lists_of_a_small_network_have_pages_too(client: Client, adapters: Adapters, city: Reported) -> None:
    finish(adapters, Job("small", "register", {}, JobStatus.ACCEPTED, NOW))
    city.blobs.write_bytes("jobs/small/result.json", json.dumps(city.whole).encode())
    assert list(paged(client, "/jobs/small/results/links?limit=100")) == city.whole["network"]["links"]


def test_a_long_document_is_not_taken_apart_for_each_page(
    client: Client, adapters: Adapters, city: Reported, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish(adapters, Job("long", "register", {}, JobStatus.ACCEPTED, NOW))
    city.blobs.write_bytes("jobs/long/result.json", json.dumps(city.whole).encode())
    monkeypatch.setattr(find_rows, "LARGEST_DOCUMENT", 10_000)
    answer = client.get("/jobs/long/results/stations")
    assert answer.status_code == 404
    assert "one long document" in answer.json()["detail"]
    assert client.get(f"/jobs/{JOB}/results/stations").status_code == 200


def test_a_list_that_is_not_there_is_refused_with_those_that_are(client: Client) -> None:
    for name in ("walls", "registered", "..%2Fpairs"):
        answer = client.get(f"/jobs/{JOB}/results/{name}")
        assert answer.status_code == 404, answer.text
    assert "it has comparison, comparison-summary, features" in client.get(f"/jobs/{JOB}/results/x").json()["detail"]


def test_a_list_that_was_wanted_by_name_is_told_by_where_it_is(
    client: Client, adapters: Adapters, city: Reported
) -> None:
    wanted = {"outputs": ["status", "pairs"], "raw": False}
    finish(adapters, Job("other", "register", {}, JobStatus.ACCEPTED, NOW, wanted=wanted))
    result = city.blobs.local_path(f"jobs/{JOB}/result.json").read_bytes()
    city.blobs.write_bytes("jobs/other/result.json", result)
    answer = client.get("/jobs/other/results").json()
    assert answer["status"] == json.loads(result)["status"]
    assert list(answer["lists"]) == ["pairs"]


def test_a_part_of_the_scene_shows_what_the_whole_one_shows_of_these_stations(client: Client, city: Reported) -> None:
    whole = city.scene
    answer = client.get(f"/jobs/{JOB}/scene?limit=10&offset=7")
    assert answer.status_code == 200, answer.text
    part, names = answer.json(), [f"S{k}" for k in range(7, 17)]
    assert (part["station_count"], part["first_station"]) == (STATIONS, 7)
    assert part["stations"] == whole["stations"][7:17]
    assert part["pairs"] == [pair for pair in whole["pairs"] if {pair["target"], pair["source"]} <= set(names)]
    assert part["stages"][-1]["poses"] == {
        name: pose for name, pose in whole["stages"][-1]["poses"].items() if name in names
    }


def test_the_drawing_of_all_lines_is_the_same(city: Reported) -> None:
    assert len(city.lines) > 1000
    assert city.blobs.local_path(f"jobs/{JOB}/artifacts/lines.ply").read_bytes() == city.lines


def test_later_steps_find_the_poses_of_all_stations(city: Reported) -> None:
    found = result_with_stations(StepContext(city.blobs, NoProgress()), f"jobs/{JOB}/result.json")
    assert found["stations"] == city.whole["stations"]
    assert found["features"] == city.whole["features"]


def test_registered_files_of_a_large_network_read_the_rows_of_their_stations_only(city: Reported) -> None:
    """Else thousands of files would each read all stations; the list of the files comes in pages as well."""
    stations = [{"name": f"S{k}", "scan": {"file": f"f{k}", "index": 0}} for k in range(STATIONS)]
    files = {f"f{k}": {"name": f"{k}.ply", "sha256": f"{k:064x}"} for k in range(STATIONS)}
    blobs, result = city.blobs, f"jobs/{JOB}/result.json"
    for file in files.values():
        blobs.write_bytes(content_key(file["sha256"]), b"")
    before = blobs.local_path(result).read_bytes()
    job = {"id": JOB, "files": files}
    (poses,) = registered_calls(job, stations, {"format": "poses"}, result)
    assert [key for key in poses.arguments["reads"] if "/lists/" in key] == [
        rows_key(JOB, name, 0) for name in ("stations", "features")
    ]
    context = StepContext(blobs, NoProgress())
    written = write_registered(context, poses.arguments)
    assert written["files"][0]["stations"] == [
        each["name"] for each in city.whole["stations"] if each["world_from_scan"] is not None
    ]
    list_registered(context, {"job_id": JOB, "result": result, "written": [written]})
    listed = read(blobs, result)["lists"]["registered"]
    assert listed["count"] == len(written["files"])
    blobs.write_bytes(result, before)


def test_the_report_shows_what_is_to_be_looked_at_first_and_says_so(city: Reported) -> None:
    page = city.blobs.local_path(f"jobs/{JOB}/artifacts/report.html").read_text()
    assert f"The network has {STATIONS} stations" in page
    assert f"/jobs/{JOB}/results/stations" in page
    assert "the protocols of 10" in page


def test_the_page_shows_stations_and_links_in_parts(client: Client) -> None:
    browser = {"Accept": "text/html", "Accept-Language": "en"}
    first = client.get(f"/jobs/{JOB}/results", headers=browser).text
    assert "stations have a pose" in first
    assert 'data-station="S0"' in first
    assert 'data-part="?offset=0&amp;limit=50"' in first
    assert f"/jobs/{JOB}/results/pairs.ndjson" in first
    pairs = client.get(f"/jobs/{JOB}/results?list=pairs", headers=browser).text
    assert 'rel="next" href="?list=pairs&amp;offset=50"' in pairs
    assert "data-station" not in pairs


def test_what_is_shown_in_parts_is_said_in_german_too(client: Client) -> None:
    page = client.get(f"/jobs/{JOB}/results", headers={"Accept": "text/html", "Accept-Language": "de"}).text
    assert "Das Netz ist groß" in page
