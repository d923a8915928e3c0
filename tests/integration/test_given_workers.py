"""Workers that Procrastinate gives their steps: cancelled, stopped, killed, without a database, taken for dead."""

import signal
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import psutil
import pytest
import sqlalchemy as sa
from engine_harness import Harness, alive, harness, wait_until

from service.ports import JobStatus
from tests.integration.test_kill_workers import worker_of
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = [pytest.mark.service, pytest.mark.timeout(1200)]

OUTAGE_S = 10.0


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    with postgres_server() as made:
        yield made


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, server: PostgresServer) -> Iterator[Harness]:
    place = tmp_path_factory.mktemp("given")
    with harness(place, database_url=server.new_database(), slots=2, queue="procrastinate") as made:
        yield made


def with_two_workers(service: Harness) -> None:
    service.workers[:] = [worker for worker in service.workers if worker.poll() is None]
    while len(service.workers) < 2:
        service.start_worker(str(len(service.workers)))
    wait_until(lambda: service.queue.live_workers() == 2, 60.0)


def begin(service: Harness, name: str, seconds: float) -> tuple[str, psutil.Process]:
    """Start a job of a short and a long step; give it and the worker that has the long one."""
    with_two_workers(service)
    stages = [
        [{"step": "nap", "name": f"{name}-{length}", "seconds": s}] for length, s in (("short", 0.1), ("long", seconds))
    ]
    job = service.submit(*stages)
    return job, worker_of(service.started(f"{name}-long"))


def end(service: Harness, job: str, name: str) -> tuple[JobStatus, int, int, int]:
    """Give status and attempts, how often the short step began, and how often the long one ended."""
    done = service.finished(job, 60.0)
    events = len(service.events("start", f"{name}-short")), len(service.events("end", f"{name}-long"))
    return (done.status, done.attempts, *events)


def test_dismissing_ends_a_computation_at_once(service: Harness) -> None:
    job, _ = begin(service, "dismissed", 60.0)
    computing = service.started("dismissed-long")
    service.jobs.dismiss(job, datetime.now(UTC))
    assert wait_until(lambda: not alive(computing), 5.0, every_s=0.01) < 1.0


def test_a_worker_that_stops_in_order_hands_its_step_back_at_once(service: Harness) -> None:
    job, worker = begin(service, "ordered", 3.0)
    worker.send_signal(signal.SIGTERM)
    wait_until(lambda: not alive(worker.pid), 10.0)
    service.started("ordered-long", times=2, within_s=5.0)
    assert end(service, job, "ordered") == (JobStatus.SUCCESSFUL, 1, 1, 1)


def test_another_worker_takes_over_from_a_killed_one(service: Harness) -> None:
    job, worker = begin(service, "killed", 2.0)
    worker.kill()
    assert end(service, job, "killed") == (JobStatus.SUCCESSFUL, 2, 1, 1)


def test_a_worker_that_was_stopped_is_taken_for_dead_and_ends_when_it_comes_back(service: Harness) -> None:
    job, worker = begin(service, "slept", 2.0)
    worker.suspend()
    service.started("slept-long", times=2, within_s=60.0)
    worker.resume()
    wait_until(lambda: not alive(worker.pid), 20.0)
    assert end(service, job, "slept")[:3] == (JobStatus.SUCCESSFUL, 2, 1)


def test_jobs_and_workers_outlast_an_outage(service: Harness, server: PostgresServer) -> None:
    job, _ = begin(service, "outage", 3.0)
    server.kill()
    time.sleep(OUTAGE_S)
    server.start()
    assert end(service, job, "outage") == (JobStatus.SUCCESSFUL, 1, 1, 1)
    assert [worker.poll() for worker in service.workers] == [None, None]


def test_in_the_end_nothing_is_left_on_the_queue(service: Harness) -> None:
    def left() -> list[object]:
        with service.engine.connect() as connection:
            return list(connection.execute(sa.text("SELECT queueing_lock FROM procrastinate_jobs")).scalars())

    wait_until(lambda: left() == [])


def test_poison_fails_alone_after_three_deaths_and_others_go_on(tmp_path: Path, server: PostgresServer) -> None:
    with harness(tmp_path, database_url=server.new_database(), slots=2, queue="procrastinate") as service:
        nap = {"step": "nap", "seconds": 0.5}
        poison = service.submit([{"step": "poison", "name": "poison"}])
        beside = [service.submit([{**nap, "name": f"a{k}"}], [{**nap, "name": f"b{k}"}]) for k in range(4)]
        worker = service.start_worker()

        def over() -> bool:
            nonlocal worker
            if worker.poll() is not None:
                worker = service.start_worker()
            return all(service.job(job).status.finished for job in (poison, *beside))

        wait_until(over, 600.0, every_s=0.2)
        assert [service.job(job).status for job in beside] == [JobStatus.SUCCESSFUL] * 4
        assert len(service.events("start", "poison")) == 3
        assert service.job(poison).message == "the worker died 3 times during this job; it was last at 'poison'"
