"""Jobs over HTTP: lists, status, results, downloads, dismissal."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.ports import Job, JobStatus, LogLine
from tests.api.conftest import Client

OGC = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/"
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
ODD_IDS = ["none", "%00", "..%2F..%2Fetc", "a" * 500, "%F0%9F%94%A5", "1 OR 1=1", "%ED%A0%80"]


@pytest.fixture
def job_of(adapters: Adapters) -> Callable[..., str]:
    """Give a maker of jobs in any status."""
    made: list[str] = []

    def make(status: JobStatus = JobStatus.ACCEPTED, process: str = "echo", **members: Any) -> str:
        created = NOW + timedelta(seconds=len(made))
        job = Job(f"job{len(made)}", process, {}, status, created=created, updated=created)
        adapters.jobs.create_and_enqueue(replace(job, **members))
        made.append(job.id)
        return job.id

    return make


def test_status_has_what_the_standard_and_the_contract_name(client: Client, job_of: Callable[..., str]) -> None:
    job = job_of(JobStatus.RUNNING, started=NOW, progress=40, message="features of A", attempts=2)
    document = client.get(f"/jobs/{job}").json()
    assert document.pop("links")
    assert document == {
        "jobID": job,
        "processID": "echo",
        "type": "process",
        "status": "running",
        "message": "features of A",
        "progress": 40,
        "attempts": 2,
        "created": "2026-01-31T12:00:00Z",
        "started": "2026-01-31T12:00:00Z",
        "updated": "2026-01-31T12:00:00Z",
    }


@pytest.mark.parametrize(
    ("status", "relations"),
    [
        (JobStatus.ACCEPTED, {"self", "dismiss", "monitor", "related"}),
        (JobStatus.RUNNING, {"self", "dismiss", "monitor", "related"}),
        (JobStatus.SUCCESSFUL, {"self", "results", "related"}),
        (JobStatus.FAILED, {"self", "results", "related"}),
        (JobStatus.DISMISSED, {"self", "related"}),
    ],
)
def test_links_tell_what_can_be_done(
    client: Client, job_of: Callable[..., str], status: JobStatus, relations: set[str]
) -> None:
    links = client.get(f"/jobs/{job_of(status)}").json()["links"]
    assert {link["rel"].rpartition("/")[2] for link in links} == relations


@pytest.mark.parametrize("job_id", ODD_IDS)
@pytest.mark.parametrize("path", ["/jobs/{}", "/jobs/{}/results", "/jobs/{}/artifacts", "/jobs/{}/artifacts/x"])
def test_an_unknown_job_is_not_found(client: Client, path: str, job_id: str) -> None:
    answer = client.get(path.format(job_id))
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


def test_an_unknown_job_is_named_as_the_standard_says(client: Client) -> None:
    assert client.get("/jobs/none").json()["type"] == OGC + "no-such-job"
    assert client.delete("/jobs/none").json()["type"] == OGC + "no-such-job"


def test_jobs_are_listed_newest_first(client: Client, job_of: Callable[..., str]) -> None:
    made = [job_of() for _ in range(3)]
    listed = [job["jobID"] for job in client.get("/jobs").json()["jobs"]]
    assert listed == made[::-1]


def test_following_next_links_visits_every_job_once(client: Client, job_of: Callable[..., str]) -> None:
    made = {job_of() for _ in range(7)}
    visited: list[str] = []
    address: str | None = "/jobs?limit=3"
    while address:
        page = client.get(address).json()
        assert page["numberMatched"] == 7
        assert page["numberReturned"] == len(page["jobs"])
        visited += [job["jobID"] for job in page["jobs"]]
        address = next((link["href"] for link in page["links"] if link["rel"] == "next"), None)
    assert len(visited) == 7
    assert set(visited) == made


def test_next_links_keep_the_filters(client: Client, job_of: Callable[..., str]) -> None:
    for _ in range(3):
        job_of(JobStatus.FAILED)
        job_of(JobStatus.ACCEPTED)
    page = client.get("/jobs?limit=2&status=failed&processID=echo").json()
    following = next(link["href"] for link in page["links"] if link["rel"] == "next")
    assert [job["status"] for job in client.get(following).json()["jobs"]] == ["failed"]


def test_jobs_are_filtered_by_status_and_process(client: Client, job_of: Callable[..., str]) -> None:
    job_of(JobStatus.FAILED, process="register")
    wanted = {job_of(JobStatus.RUNNING, process="register"), job_of(JobStatus.ACCEPTED, process="register")}
    job_of(JobStatus.RUNNING, process="echo")
    page = client.get("/jobs?status=running,accepted&processID=register").json()
    assert {job["jobID"] for job in page["jobs"]} == wanted


@pytest.mark.parametrize("process", ["nothing", "%00", "'; drop table jobs", "register%2Cnothing%00"])
def test_filtering_by_an_unknown_process_finds_nothing(
    client: Client, job_of: Callable[..., str], process: str
) -> None:
    job_of()
    assert client.get(f"/jobs?processID={process}").json()["jobs"] == []


@pytest.mark.parametrize(
    ("query", "pointer"),
    [
        ("limit=0", "/query/limit"),
        ("limit=-1", "/query/limit"),
        ("limit=many", "/query/limit"),
        ("offset=-1", "/query/offset"),
        (f"offset={10**30}", "/query/offset"),
        ("status=asleep", "/query/status"),
    ],
)
def test_a_bad_query_is_pointed_at(
    client: Client, pointers: Callable[[httpx.Response], list[str]], query: str, pointer: str
) -> None:
    assert pointers(client.get(f"/jobs?{query}")) == [pointer]


def test_a_huge_limit_is_bounded(client: Client, job_of: Callable[..., str]) -> None:
    job_of()
    answer = client.get(f"/jobs?limit={10**30}")
    assert answer.status_code == 200
    assert len(answer.json()["jobs"]) == 1


def test_the_result_is_sent_as_it_was_stored(client: Client, adapters: Adapters, job_of: Callable[..., str]) -> None:
    job = job_of(JobStatus.SUCCESSFUL)
    adapters.blobs.write_bytes(f"jobs/{job}/result.json", b'{"status": "registered", "tx_m": 1.0000000000000002}')
    answer = client.get(f"/jobs/{job}/results")
    assert answer.content == b'{"status": "registered", "tx_m": 1.0000000000000002}'
    assert answer.headers["content-type"] == "application/json"


@pytest.mark.parametrize("status", [JobStatus.ACCEPTED, JobStatus.RUNNING])
def test_a_result_that_does_not_exist_yet_is_not_ready(
    client: Client, job_of: Callable[..., str], status: JobStatus
) -> None:
    answer = client.get(f"/jobs/{job_of(status)}/results")
    assert answer.status_code == 404
    assert answer.json()["type"] == OGC + "result-not-ready"


def test_a_failed_job_answers_with_its_own_problem(client: Client, job_of: Callable[..., str]) -> None:
    problem = {"type": "about:blank", "title": "Unreadable file", "status": 400, "detail": "a.e57: torn", "file": "a"}
    answer = client.get(f"/jobs/{job_of(JobStatus.FAILED, problem=problem)}/results")
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json().items() >= problem.items()


def test_a_dismissed_job_has_no_result_any_more(client: Client, job_of: Callable[..., str]) -> None:
    assert client.get(f"/jobs/{job_of(JobStatus.DISMISSED)}/results").status_code == 410


def test_a_lost_result_is_the_fault_of_the_service(client: Client, job_of: Callable[..., str]) -> None:
    assert client.get(f"/jobs/{job_of(JobStatus.SUCCESSFUL)}/results").status_code == 503


@pytest.mark.parametrize("status", [JobStatus.ACCEPTED, JobStatus.RUNNING])
def test_dismissing_stops_a_job_and_keeps_its_status(
    client: Client, job_of: Callable[..., str], status: JobStatus
) -> None:
    job = job_of(status)
    answer = client.delete(f"/jobs/{job}")
    assert answer.status_code == 200
    assert answer.json()["status"] == "dismissed"
    assert client.get(f"/jobs/{job}").json()["status"] == "dismissed"


@pytest.mark.parametrize("status", [JobStatus.SUCCESSFUL, JobStatus.FAILED, JobStatus.DISMISSED])
def test_dismissing_a_finished_job_removes_it_with_all_it_stored(
    client: Client, adapters: Adapters, job_of: Callable[..., str], status: JobStatus
) -> None:
    job = job_of(status)
    for key in ("result.json", "artifacts/poses.csv"):
        adapters.blobs.write_bytes(f"jobs/{job}/{key}", b"x")
    answer = client.delete(f"/jobs/{job}")
    assert answer.status_code == 200
    assert answer.json()["status"] == "dismissed"
    assert client.get(f"/jobs/{job}").status_code == 404
    assert not adapters.blobs.keys(f"jobs/{job}/")


@pytest.fixture
def with_artifacts(adapters: Adapters, job_of: Callable[..., str]) -> str:
    job = job_of(JobStatus.SUCCESSFUL)
    for name, content in {"poses.csv": b"0123456789", "report.html": b"<p>", "S1.txt": b"1 0 0 0"}.items():
        adapters.blobs.write_bytes(f"jobs/{job}/artifacts/{name}", content)
    return job


def test_downloads_are_listed_with_type_and_size(client: Client, with_artifacts: str) -> None:
    listed = {each["name"]: each for each in client.get(f"/jobs/{with_artifacts}/artifacts").json()["artifacts"]}
    assert set(listed) == {"poses.csv", "report.html", "S1.txt"}
    assert listed["poses.csv"]["type"] == "text/csv"
    assert listed["poses.csv"]["bytes"] == 10
    assert client.get(listed["poses.csv"]["href"]).content == b"0123456789"


def test_a_range_of_a_download_can_be_fetched(client: Client, with_artifacts: str) -> None:
    answer = client.get(f"/jobs/{with_artifacts}/artifacts/poses.csv", headers={"Range": "bytes=2-4"})
    assert answer.status_code == 206
    assert answer.content == b"234"


@pytest.mark.parametrize("name", ["none.csv", "..%2Fresult.json", "%2e%2e", "%00", "a%20b", ".hidden"])
def test_a_download_that_does_not_exist_is_not_found(client: Client, with_artifacts: str, name: str) -> None:
    assert client.get(f"/jobs/{with_artifacts}/artifacts/{name}").status_code == 404


def test_the_log_tells_what_happened_in_order(client: Client, adapters: Adapters, job_of: Callable[..., str]) -> None:
    job = job_of(JobStatus.FAILED)
    adapters.log.write(job, [LogLine(NOW, "info", "features of A: begun"), LogLine(NOW, "error", "no points")])
    answer = client.get(f"/jobs/{job}/log")
    assert answer.headers["content-type"] == "text/plain; charset=utf-8"
    assert answer.text.splitlines() == [
        "2026-01-31T12:00:00.000+00:00 info    features of A: begun",
        "2026-01-31T12:00:00.000+00:00 error   no points",
    ]


def test_the_log_of_a_job_that_does_not_exist_is_a_problem(client: Client) -> None:
    assert client.get("/jobs/none/log").status_code == 404
