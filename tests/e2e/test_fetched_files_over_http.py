"""Scans that a request names by their address: fetched by the job, whatever happens meanwhile."""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.e2e.file_server import FileServer, serving_files
from tests.e2e.running_service import Document, RunningService, wait_until
from tests.object_server import ObjectServer

pytestmark = pytest.mark.service


@pytest.fixture(scope="module")
def elsewhere() -> Iterator[FileServer]:
    with serving_files() as server:
        yield server


@pytest.fixture(scope="module")
def bucket(objects: ObjectServer) -> str:
    return objects.new_place()


@pytest.fixture(scope="module")
def fetching(
    tmp_path_factory: pytest.TempPathFactory, elsewhere: FileServer, bucket: str, objects: ObjectServer
) -> Iterator[RunningService]:
    settings = {
        "SLOTS": "2",
        "ALLOWED_SOURCES": f"{elsewhere.url}/, {bucket}",
        "ALLOW_PRIVATE_SOURCES": "true",
        "MAX_FILE_BYTES": "50000000",
        "MAX_ATTEMPTS": "5",
    }
    service = RunningService(tmp_path_factory.mktemp("fetching"), settings, objects.credentials)
    service.start()
    yield service
    service.stop()


def register(*hrefs: str) -> dict[str, Any]:
    return {"stations": [{"name": f"S{number}", "scan": {"href": href}} for number, href in enumerate(hrefs, start=1)]}


def failed(service: RunningService, job_id: str) -> Document:
    job = service.finished(job_id)
    assert job["status"] == "failed"
    return dict(service.http.get(f"/jobs/{job_id}/results").json())


def xyz(points: int) -> bytes:
    return b"".join(b"%d.5 %d.25 1.125\n" % (number, number % 97) for number in range(points))


def test_scans_of_two_kinds_of_servers_are_registered(
    fetching: RunningService, elsewhere: FileServer, objects: ObjectServer, bucket: str, house: Sequence[Path]
) -> None:
    first, second = (path.read_bytes() for path in house)
    place, _, _ = bucket.partition("?")
    name = place.removeprefix("s3://")
    httpx.put(f"{objects.endpoint}/{name}/second.e57", content=second).raise_for_status()
    href = elsewhere.put("/first.e57", first)
    job = fetching.execute("register", register(href, f"{place}/second.e57"))
    result = fetching.result(job)
    assert result["status"] == "registered"
    files = {file["name"]: file for file in fetching.http.get("/files").json()["files"]}
    assert files["first.e57"]["sha256"] == hashlib.sha256(first).hexdigest()
    assert files["second.e57"]["sha256"] == hashlib.sha256(second).hexdigest()
    log = fetching.http.get(f"/jobs/{job}/log").text
    assert "fetching S1: done" in log
    assert "checking the files: done" in log


def test_the_progress_of_a_slow_server_is_seen_and_the_answer_does_not_wait_for_it(
    fetching: RunningService, elsewhere: FileServer
) -> None:
    href = elsewhere.put("/slow.xyz", xyz(60_000), pause_s=0.15)
    job = fetching.execute("extract-lines", {"station": register(href)["stations"][0]})
    wait_until(lambda: "fetching S1: " in fetching.job(job)["message"] and "%" in fetching.job(job)["message"], 20.0)
    file_id = fetching.http.get(f"/jobs/{job}").json()["jobID"]
    assert file_id == job
    fetching.http.delete(f"/jobs/{job}")
    wait_until(lambda: not [name for name in fetching.stored() if "incoming" in name or "partial" in name], 20.0)


def test_a_killed_worker_begins_the_download_again_and_the_file_is_there_once(
    fetching: RunningService, elsewhere: FileServer
) -> None:
    content = xyz(40_000)
    href = elsewhere.put("/killed.xyz", content, pause_s=0.1)
    job = fetching.execute("extract-lines", {"station": register(href)["stations"][0]})
    wait_until(lambda: "%" in fetching.job(job)["message"], 20.0)
    fetching.worker().kill()
    fetching.finished(job)
    assert elsewhere.asked.count("/killed.xyz") == 2
    files = [file for file in fetching.http.get("/files").json()["files"] if file["name"] == "killed.xyz"]
    assert [file["sha256"] for file in files] == [hashlib.sha256(content).hexdigest()]


def test_what_cannot_be_fetched_fails_the_job_with_a_pointer(fetching: RunningService, elsewhere: FileServer) -> None:
    there = elsewhere.put("/there.xyz", xyz(100))
    problem = failed(fetching, fetching.execute("register", register(there, f"{elsewhere.url}/none.xyz")))
    assert (problem["status"], problem["title"]) == (400, "Address refused")
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/stations/1/scan/href"]
    assert "404" in problem["detail"]


def test_what_is_no_scan_fails_the_job_and_nothing_is_kept(fetching: RunningService, elsewhere: FileServer) -> None:
    href = elsewhere.put("/nonsense.e57", b"nonsense" * 1000)
    before = fetching.stored()
    problem = failed(fetching, fetching.execute("extract-lines", {"station": register(href)["stations"][0]}))
    assert (problem["status"], problem["title"]) == (400, "Unreadable file")
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/station/scan/href"]
    assert fetching.stored() == before


def test_what_is_too_large_fails_the_job(fetching: RunningService, elsewhere: FileServer) -> None:
    href = elsewhere.put("/large.xyz", bytes(50_000_001))
    problem = failed(fetching, fetching.execute("extract-lines", {"station": register(href)["stations"][0]}))
    assert (problem["status"], problem["title"]) == (413, "Too large")


def test_a_number_that_the_file_does_not_have_fails_the_job(fetching: RunningService, elsewhere: FileServer) -> None:
    href = elsewhere.put("/single.xyz", xyz(100))
    station = {"name": "S1", "scan": {"href": href, "index": 7}}
    problem = failed(fetching, fetching.execute("extract-lines", {"station": station}))
    assert problem["status"] == 400
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/station/scan/index"]


@pytest.mark.parametrize("href", ["http://169.254.169.254/a.e57", "s3://other/a.e57", "file:///etc/passwd"])
def test_other_servers_are_refused_at_once(fetching: RunningService, href: str) -> None:
    answer = fetching.post("/processes/register/execution", json={"inputs": register(href, href)})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"] == "/inputs/stations/0/scan/href"
