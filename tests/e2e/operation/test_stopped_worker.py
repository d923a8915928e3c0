"""A worker is stopped in the middle of a transaction: its locks are free in seconds, and its job is taken over."""

import time
from pathlib import Path

import httpx
import psutil
import pytest

from service.settings import Settings
from service.supervisor import STOPPED_FOR_S
from tests.e2e.running.running_service import RunningService, wait_until
from tests.integration.stopping_transactions import STOP
from tests.measures.patience import patience
from tests.servers.databases import DATABASES, databases_of

pytestmark = pytest.mark.service

LONGEST_S = 20.0


@pytest.mark.parametrize("kind", DATABASES)
def test_others_go_on_and_its_job_is_taken_over(tmp_path: Path, kind: str, request: pytest.FixtureRequest) -> None:
    url = databases_of(request, kind)()
    # an embedded database has one worker, which goes on with its own jobs when it has been started again
    count = 1 if Settings(database_url=url).embedded_database else 2
    settings = {"WORKERS": str(count), "SLOTS": str(3 - count), "DATABASE_URL": url}
    service = RunningService(tmp_path, settings, program=("tests.e2e.operation.stopping_service",))
    service.start()
    try:
        wait_until(lambda: len(service.workers()) == count)
        jobs = [service.execute("echo", {"pause": 3}, Prefer="respond-async") for _ in range(2)]
        wait_until(lambda: all(service.job(job)["status"] == "running" for job in jobs))
        (service.data / STOP).touch()
        wait_until(lambda: [is_stopped(worker) for worker in service.workers()].count(True) == 1, 20.0)
        began = time.monotonic()
        # what only reads is answered meanwhile; what writes waits for the lock, or is told so in words
        assert httpx.get(f"{service.url}/jobs", timeout=LONGEST_S * patience()).status_code == 200
        answer = httpx.post(
            f"{service.url}/processes/echo/execution",
            json={"inputs": {"pause": 0}},
            headers={"Prefer": "respond-async"},
            timeout=LONGEST_S * patience(),
        )
        print(f"{answer.status_code} after {time.monotonic() - began:.1f} s")
        if answer.status_code == 503:
            assert "busy" in answer.json()["detail"]
            assert int(answer.headers["Retry-After"]) > 0
        else:
            assert answer.status_code == 201
            jobs.append(answer.json()["jobID"])
        wait_until(lambda: "process is stopped and is killed" in service.log, STOPPED_FOR_S + 10.0)
        assert [service.finished(job)["status"] for job in jobs] == ["successful"] * len(jobs)
        wait_until(lambda: [is_stopped(worker) for worker in service.workers()] == [False] * count)
    finally:
        service.stop()


def is_stopped(process: psutil.Process) -> bool:
    try:
        return process.status() == psutil.STATUS_STOPPED
    except psutil.NoSuchProcess:
        return False
