"""Scans that a request names by their address: fetched by the job, whatever happens meanwhile."""

import hashlib
from contextlib import suppress
from typing import Any

import httpx
import pytest

from tests.e2e.running.file_server import FileServer
from tests.e2e.running.running_service import Document, RunningService, wait_until
from tests.servers.object_server import ObjectServer

pytestmark = pytest.mark.service


def register(*hrefs: str) -> dict[str, Any]:
    return {"stations": [{"name": f"S{number}", "scan": {"href": href}} for number, href in enumerate(hrefs, start=1)]}


def failed(service: RunningService, job_id: str) -> Document:
    job = service.finished(job_id)
    assert job["status"] == "failed"
    return dict(service.http.get(f"/jobs/{job_id}/results").json())


def all_at_rest(service: RunningService) -> None:
    """Wait until nothing is on its way in; steps of a job that has ended may still be ending themselves."""

    def coming() -> list[str]:
        return [name for name in service.stored() if "incoming" in name or "partial" in name]

    with suppress(AssertionError):  # the names tell more than the time
        wait_until(lambda: not coming(), 60.0)
    assert coming() == []


def xyz(points: int) -> bytes:
    return b"".join(b"%d.5 %d.25 1.125\n" % (37 * number % 1009, number % 97) for number in range(points))


def corner() -> bytes:
    """Make three walls that meet, two metres wide."""
    steps = [number * 0.05 for number in range(41)]
    walls = [(a, b, 0.0) for a in steps for b in steps] + [(a, 0.0, b) for a in steps for b in steps]
    walls += [(0.0, a, b) for a in steps for b in steps]
    return b"".join(b"%.3f %.3f %.3f\n" % point for point in walls)


def test_scans_of_both_kinds_of_servers_are_used(
    reaching: RunningService, elsewhere: FileServer, objects: ObjectServer, bucket: str
) -> None:
    content, place = corner(), bucket.partition("?")[0]
    httpx.put(f"{objects.endpoint}/{place.removeprefix('s3://')}/a%20b.xyz", content=content).raise_for_status()
    jobs = [
        reaching.execute("extract-lines", {"station": register(href)["stations"][0]})
        for href in (elsewhere.put("/corner.xyz", content), f"{place}/a%20b.xyz")
    ]
    for job in jobs:
        assert reaching.result(job)["lines"]
        log = reaching.http.get(f"/jobs/{job}/log").text
        assert "fetching S1: done" in log
        assert "checking the files: done" in log
    files = {file["name"]: file["sha256"] for file in reaching.http.get("/files").json()["files"]}
    assert files["corner.xyz"] == files["a b.xyz"] == hashlib.sha256(content).hexdigest()


def test_the_progress_of_a_slow_server_is_seen_and_the_answer_does_not_wait_for_it(
    reaching: RunningService, elsewhere: FileServer
) -> None:
    href = elsewhere.put("/slow.xyz", xyz(60_000), pause_s=0.15)
    job = reaching.execute("extract-lines", {"station": register(href)["stations"][0]})
    wait_until(lambda: "fetching S1: " in reaching.job(job)["message"] and "%" in reaching.job(job)["message"], 60.0)
    reaching.http.delete(f"/jobs/{job}")
    all_at_rest(reaching)


def test_a_killed_worker_begins_the_download_again_and_the_file_is_there_once(
    reaching: RunningService, elsewhere: FileServer
) -> None:
    content = xyz(40_000)
    href = elsewhere.put("/killed.xyz", content, pause_s=0.1)
    station = {"name": "S1", "scan": {"href": href, "index": 1}}  # none to compute with
    job = reaching.execute("extract-lines", {"station": station})
    wait_until(lambda: "%" in reaching.job(job)["message"], 60.0)
    reaching.worker().kill()
    assert "index" in failed(reaching, job)["errors"][0]["pointer"]
    assert elsewhere.asked.count("/killed.xyz") == 2
    files = [file for file in reaching.http.get("/files").json()["files"] if file["name"] == "killed.xyz"]
    assert [file["sha256"] for file in files] == [hashlib.sha256(content).hexdigest()]


def test_what_cannot_be_fetched_fails_the_job_with_a_pointer(reaching: RunningService, elsewhere: FileServer) -> None:
    there = elsewhere.put("/there.xyz", xyz(100))
    problem = failed(reaching, reaching.execute("register", register(there, f"{elsewhere.url}/none.xyz")))
    assert (problem["status"], problem["title"]) == (400, "Address refused")
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/stations/1/scan/href"]
    assert "404" in problem["detail"]


def test_what_is_no_scan_fails_the_job_and_nothing_is_kept(reaching: RunningService, elsewhere: FileServer) -> None:
    href = elsewhere.put("/nonsense.e57", b"nonsense" * 1000)
    all_at_rest(reaching)
    before = reaching.stored()
    problem = failed(reaching, reaching.execute("extract-lines", {"station": register(href)["stations"][0]}))
    assert (problem["status"], problem["title"]) == (400, "Unreadable file")
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/station/scan/href"]
    assert reaching.stored() == before


def test_what_is_too_large_fails_the_job(reaching: RunningService, elsewhere: FileServer) -> None:
    href = elsewhere.put("/large.xyz", bytes(50_000_001))
    problem = failed(reaching, reaching.execute("extract-lines", {"station": register(href)["stations"][0]}))
    assert (problem["status"], problem["title"]) == (413, "Too large")


def test_a_number_that_the_file_does_not_have_fails_the_job(reaching: RunningService, elsewhere: FileServer) -> None:
    href = elsewhere.put("/single.xyz", xyz(100))
    station = {"name": "S1", "scan": {"href": href, "index": 7}}
    problem = failed(reaching, reaching.execute("extract-lines", {"station": station}))
    assert problem["status"] == 400
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/station/scan/index"]


@pytest.mark.parametrize("href", ["http://169.254.169.254/a.e57", "s3://other/a.e57", "file:///etc/passwd"])
def test_other_servers_are_refused_at_once(reaching: RunningService, href: str) -> None:
    answer = reaching.post("/processes/register/execution", json={"inputs": register(href, href)})
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["pointer"] == "/inputs/stations/0/scan/href"
