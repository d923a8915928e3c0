"""Workers die again and again: jobs that wait lose nothing, and only what takes its worker down fails."""

import random
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import psutil
import pytest
from engine_harness import Harness, harness, wait_until

from service.ports import JobStatus
from tests.servers.databases import NewDatabase

pytestmark = [pytest.mark.service, pytest.mark.timeout(1200)]

WITHIN_S = 600.0


@pytest.fixture
def service(tmp_path: Path, new_database: NewDatabase) -> Iterator[Harness]:
    with harness(tmp_path, database_url=new_database(), slots=2) as made:
        yield made


def two_steps(service: Harness, name: str, seconds: float = 0.5) -> str:
    nap = {"step": "nap", "seconds": seconds}
    return service.submit([{**nap, "name": f"{name}-first"}], [{**nap, "name": f"{name}-second"}])


def statuses(service: Harness, jobs: Sequence[str]) -> list[JobStatus]:
    return [service.finished(job, WITHIN_S).status for job in jobs]


def wait_for_another_start(service: Harness, before: int) -> None:
    wait_until(lambda: begun(service) > before, WITHIN_S)


def begun(service: Harness) -> int:
    return len(service.events("start"))


def test_three_deaths_of_a_worker_fail_none_of_the_jobs_that_wait(service: Harness) -> None:
    jobs = [two_steps(service, f"j{number}") for number in range(24)]
    for _ in range(3):
        before = begun(service)
        worker = service.start_worker()
        wait_for_another_start(service, before)
        worker.kill()
        worker.wait()
    service.start_worker()
    assert statuses(service, jobs) == [JobStatus.SUCCESSFUL] * 24
    # two were computed at most when a worker died
    assert sum(service.job(job).attempts - 1 for job in jobs) <= 6


def test_ten_kills_of_everything_lose_none_of_thirty_jobs(service: Harness) -> None:
    rng = random.Random(1)
    jobs = [two_steps(service, f"j{number}", 0.3) for number in range(30)]
    for _ in range(10):
        before = begun(service)
        launcher = service.start_launched_worker()
        wait_for_another_start(service, before)
        family = psutil.Process(launcher.pid).children(recursive=True)
        time.sleep(rng.uniform(0.0, 0.5))
        launcher.kill()
        launcher.wait()
        psutil.wait_procs(family, 60.0)
    service.start_launched_worker()
    assert statuses(service, jobs) == [JobStatus.SUCCESSFUL] * 30


def test_poison_fails_alone_after_three_deaths_and_takes_nobody_along(service: Harness) -> None:
    beside = [two_steps(service, f"before{number}") for number in range(2)]
    poison = service.submit([{"step": "poison", "name": "poison"}])
    beside += [two_steps(service, f"after{number}", 1.0) for number in range(4)]
    worker = service.start_worker()

    def over() -> bool:
        nonlocal worker
        if worker.poll() is not None:
            worker = service.start_worker()
        return all(service.job(job).status.finished for job in (poison, *beside))

    wait_until(over, WITHIN_S, every_s=0.2)
    failed = service.job(poison)
    assert statuses(service, beside) == [JobStatus.SUCCESSFUL] * 6
    assert (failed.status, len(service.events("start", "poison"))) == (JobStatus.FAILED, 3)
    assert failed.message == "the worker died 3 times during this job; it was last at 'poison'"
