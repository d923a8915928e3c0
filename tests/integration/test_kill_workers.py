"""A worker stops or is killed: another goes on with its job, and finished steps are not repeated."""

import signal
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import sqlalchemy as sa
from engine_harness import Harness, alive, harness, wait_until

from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import job_steps
from service.adapters.database.tables import jobs as jobs_table
from service.ports import JobStatus, StepCall
from tests.integration.stopping_transactions import STOP
from tests.servers.databases import NewDatabase

pytestmark = pytest.mark.service

SHORT = {"step": "nap", "seconds": 0.1}
LONG = {"step": "nap", "seconds": 1.5}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, new_database: NewDatabase) -> Iterator[Harness]:
    with harness(tmp_path_factory.mktemp("workers"), database_url=new_database()) as made:
        yield made


def with_workers(service: Harness) -> None:
    """Start what is missing of two workers, or of the one of an embedded database; there may be some left."""
    number = 1 if service.settings.embedded_database else 2
    service.workers[:] = [worker for worker in service.workers if worker.poll() is None]
    while len(service.workers) < number:
        service.start_worker(str(len(service.workers)))
    wait_until(lambda: service.queue.live_workers() == number)


def with_successor(service: Harness) -> None:
    """Start another worker where there was only one; of two the other goes on."""
    if service.settings.embedded_database:
        service.workers[-1].wait()
        service.start_worker()


def worker_of(computing: int) -> psutil.Process:
    """Give the worker whose nursery a computation is a copy of."""
    nursery = psutil.Process(computing).parent()
    assert nursery is not None
    worker = nursery.parent()
    assert worker is not None
    return worker


def is_stopped(pid: int) -> bool:
    return psutil.Process(pid).status() == psutil.STATUS_STOPPED


def submit(service: Harness, name: str) -> tuple[str, int]:
    """Start a job of a short and a long step; give it and the process that runs the long one."""
    job = service.submit([{**SHORT, "name": f"{name}-short"}], [{**LONG, "name": f"{name}-long"}])
    return job, service.started(f"{name}-long")


def how_often(service: Harness, name: str) -> tuple[int, int]:
    """Count the starts of the short step and the ends of the long one."""
    return len(service.events("start", f"{name}-short")), len(service.events("end", f"{name}-long"))


def test_a_worker_that_stops_in_order_hands_its_step_over_without_counting_an_attempt(service: Harness) -> None:
    with_workers(service)
    job, computing = submit(service, "ordered")
    worker = worker_of(computing)
    worker.send_signal(signal.SIGTERM)
    wait_until(lambda: not alive(computing) and not alive(worker.pid), 10.0)
    with_successor(service)
    finished = service.finished(job)
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 1)
    assert how_often(service, "ordered") == (1, 1)


@pytest.mark.e2e
def test_another_worker_takes_over_from_a_killed_one(service: Harness) -> None:
    with_workers(service)
    job, computing = submit(service, "killed")
    worker_of(computing).kill()
    with_successor(service)
    finished = service.finished(job)
    assert finished.status is JobStatus.SUCCESSFUL
    assert how_often(service, "killed") == (1, 1)


def test_a_worker_that_was_stopped_for_long_was_taken_for_dead_and_ends_when_it_comes_back(service: Harness) -> None:
    if service.settings.embedded_database:
        pytest.skip("there is only one worker, which nobody takes for dead")
    with_workers(service)
    job, computing = submit(service, "slept")
    worker = worker_of(computing)
    worker.suspend()
    wait_until(lambda: service.queue.live_workers() == 1, 30.0)
    wait_until(lambda: len(service.events("start", "slept-long")) == 2)
    worker.resume()
    wait_until(lambda: not alive(worker.pid), 20.0)
    finished = service.finished(job)
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 2)


def test_a_server_frees_what_a_worker_holds_that_is_stopped_in_a_transaction(service: Harness) -> None:
    if not service.settings.database_url:
        pytest.skip("an embedded database does not notice; the worker's launcher kills it then")
    with_workers(service)
    jobs = [submit(service, f"held-{number}")[0] for number in range(2)]
    (service.settings.data_dir / STOP).touch()
    wait_until(lambda: [is_stopped(worker.pid) for worker in service.workers].count(True) == 1)
    took_s = wait_until(lambda: all(service.job(job).status is JobStatus.SUCCESSFUL for job in jobs), 60.0)
    print(f"jobs of a stopped worker and beside it ended after {took_s:.1f} s")


@pytest.mark.e2e
def test_a_job_that_takes_its_worker_down_fails_and_says_where(tmp_path: Path, new_database: NewDatabase) -> None:
    with harness(tmp_path, database_url=new_database(), max_attempts=1) as service:
        service.start_worker()
        job = service.submit([{**LONG, "seconds": 60, "name": "poison"}])
        service.started("poison")
        wait_until(lambda: "napping" in service.job(job).message)
        service.kill_all()
        service.start_worker()
        failed = service.finished(job)
        assert (failed.status, len(service.events("start", "poison"))) == (JobStatus.FAILED, 1)
        assert failed.message == "the worker died 1 times during this job; it was last at 'poison: napping'"


@pytest.mark.e2e
def test_jobs_of_another_order_of_steps_and_jobs_whose_steps_were_lost_are_begun_again(
    tmp_path: Path, new_database: NewDatabase
) -> None:
    with harness(tmp_path, database_url=new_database()) as service:
        jobs = [service.submit([{**SHORT, "name": name}]) for name in ("older", "lost")]
        steps = DatabaseSteps(service.engine)
        for job in jobs:
            steps.plan_stage(job, 0, [StepCall("unknown", {}, "what an older version did")], 1.0)
        older, lost = jobs
        with service.engine.begin() as connection:
            connection.execute(sa.update(jobs_table).where(jobs_table.c.id == older).values(planned=1000))
            connection.execute(sa.delete(job_steps).where(job_steps.c.job_id == lost))
        service.start_worker()
        assert [service.finished(job).status for job in jobs] == [JobStatus.SUCCESSFUL] * 2


def test_a_second_worker_of_an_embedded_database_is_refused(tmp_path: Path) -> None:
    with harness(tmp_path) as service:
        service.start_worker()
        wait_until(lambda: service.queue.live_workers() == 1)
        second = service.start_worker("1")
        wait_until(lambda: second.poll() is not None)
        assert (second.returncode, service.queue.live_workers()) == (1, 1)
        assert "several need PostgreSQL" in (service.settings.data_dir / "worker.log").read_text()
