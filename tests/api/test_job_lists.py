"""Lists of jobs by type, status, process, time and duration (OGC API - Processes 1.0, conformance class job-list)."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from service.dependencies import Adapters
from service.ports import Job, JobStatus
from tests.api.conftest import Client

NOON = datetime(2026, 1, 31, 12, 0, 0, 250_000, tzinfo=UTC)
MINUTE = timedelta(minutes=1)
SCENE = {
    "waiting": Job("waiting", "register", {}, JobStatus.ACCEPTED, NOON + 3 * MINUTE),
    "running": Job("running", "register", {}, JobStatus.RUNNING, NOON + 2 * MINUTE, started=NOON + 2 * MINUTE),
    "quick": Job(
        "quick", "echo", {}, JobStatus.SUCCESSFUL, NOON + MINUTE, NOON + MINUTE, NOON + MINUTE + timedelta(seconds=5)
    ),
    "slow": Job("slow", "register", {}, JobStatus.FAILED, NOON, started=NOON, finished=NOON + 10 * MINUTE),
    "never": Job("never", "register", {}, JobStatus.DISMISSED, NOON - MINUTE, finished=NOON),
}


@pytest.fixture(autouse=True)
def _jobs(adapters: Adapters) -> None:
    for job in SCENE.values():
        adapters.jobs.create_and_enqueue(replace(job, updated=job.created))


def listed(client: Client, **query: str | int) -> list[str]:
    answer = client.get("/jobs", params=query)
    assert answer.status_code == 200, answer.text
    return [job["jobID"] for job in answer.json()["jobs"]]


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ({}, ["waiting", "running", "quick", "slow", "never"]),
        ({"type": "process"}, ["waiting", "running", "quick", "slow", "never"]),
        ({"status": "failed,running"}, ["running", "slow"]),
        ({"processID": "echo"}, ["quick"]),
        ({"processID": "unheard-of"}, []),
        ({"datetime": "2026-01-31T12:00:00Z"}, ["slow"]),
        ({"datetime": "2026-01-31T12:00:00.25Z"}, ["slow"]),
        ({"datetime": "2026-01-31T12:00:00.26Z"}, []),
        ({"datetime": "2026-01-31T13:00:00.25+01:00"}, ["slow"]),
        ({"datetime": "2026-01-31T12:00:00Z/2026-01-31T12:01:00Z"}, ["quick", "slow"]),
        ({"datetime": "2026-01-31T12:02:00Z/.."}, ["waiting", "running"]),
        ({"datetime": "2026-01-31t12:02:00z/"}, ["waiting", "running"]),
        ({"datetime": "../2026-01-31T12:00:00Z"}, ["slow", "never"]),
        ({"datetime": "/2026-01-31T12:00:00Z"}, ["slow", "never"]),
        ({"datetime": "2026-01-31T12:02:00Z/9999-12-31T23:59:59Z"}, ["waiting", "running"]),
        ({"datetime": "2026-01-31T12:02:00Z/2026-01-31T12:00:00Z"}, []),
        ({"minDuration": 0}, ["running", "quick", "slow"]),
        ({"minDuration": 6}, ["running", "slow"]),
        ({"maxDuration": 5}, ["quick"]),
        ({"maxDuration": 600}, ["quick", "slow"]),
        ({"minDuration": 6, "maxDuration": 600}, ["slow"]),
        ({"minDuration": 6, "status": "failed"}, ["slow"]),
        ({"minDuration": 0, "status": "accepted"}, []),
        ({"minDuration": 6, "processID": "echo"}, []),
    ],
)
def test_only_what_was_asked_for_is_listed(client: Client, query: dict[str, str | int], expected: list[str]) -> None:
    assert listed(client, **query) == expected


@pytest.mark.parametrize(
    ("query", "pointer"),
    [
        ({"type": "wps"}, "/query/type"),
        ({"status": "done"}, "/query/status"),
        ({"status": "failed,done"}, "/query/status"),
        ({"limit": "0"}, "/query/limit"),
        ({"limit": "many"}, "/query/limit"),
        ({"offset": "-1"}, "/query/offset"),
        ({"minDuration": "-1"}, "/query/minDuration"),
        ({"maxDuration": "1.5"}, "/query/maxDuration"),
        ({"minDuration": "0.0"}, "/query/minDuration"),
        ({"limit": "1.0"}, "/query/limit"),
        ({"offset": "١"}, "/query/offset"),
        ({"maxDuration": "9" * 30}, "/query/maxDuration"),
        ({"datetime": ""}, "/query/datetime"),
        ({"datetime": ".."}, "/query/datetime"),
        ({"datetime": "../.."}, "/query/datetime"),
        ({"datetime": "/"}, "/query/datetime"),
        ({"datetime": "yesterday"}, "/query/datetime"),
        ({"datetime": "2026-01-31"}, "/query/datetime"),
        ({"datetime": "2026-01-31T12:00:00"}, "/query/datetime"),
        ({"datetime": "2026-02-31T12:00:00Z"}, "/query/datetime"),
        ({"datetime": "2026-01-31T12:00:00+99:00"}, "/query/datetime"),
        ({"datetime": "2026-01-31T12:00:00Z/x"}, "/query/datetime"),
    ],
)
def test_a_wrong_filter_is_pointed_at(
    client: Client, pointers: Callable[[httpx.Response], list[str]], query: dict[str, str], pointer: str
) -> None:
    assert pointers(client.get("/jobs", params=query)) == [pointer]


def test_links_to_other_pages_keep_what_was_asked_for(client: Client) -> None:
    asked = {"minDuration": "0", "datetime": "2026-01-01T00:00:00Z/..", "type": "process", "status": "failed,running"}
    links = {link["rel"]: link["href"] for link in client.get("/jobs", params={**asked, "limit": 1}).json()["links"]}
    repeated = parse_qs(urlsplit(links["next"]).query)
    assert repeated == {
        "minDuration": ["0"],
        "datetime": ["2026-01-01T00:00:00Z/.."],
        "type": ["process"],
        "status": ["failed", "running"],
        "limit": ["1"],
        "offset": ["1"],
    }
    again = client.get(links["next"])
    assert [job["jobID"] for job in again.json()["jobs"]] == ["slow"]


def test_pages_hold_every_job_once(client: Client) -> None:
    found, address = [], "/jobs?limit=2"
    while address:
        page = client.get(address).json()
        found += [job["jobID"] for job in page["jobs"]]
        address = next((link["href"] for link in page["links"] if link["rel"] == "next"), "")
    assert found == list(SCENE)


def test_more_than_the_largest_page_is_never_given(client: Client) -> None:
    (itself,) = client.get("/jobs?limit=1000000").json()["links"]
    assert "limit=10000&" in itself["href"]
