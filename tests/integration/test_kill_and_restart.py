"""kill -9 of a computation, a worker, everything: the job goes on, and finished steps are not repeated."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from engine_harness import HERE, Harness, alive, harness, wait_until

from service.ports import JobStatus

FIRST = {"step": "nap", "name": "first", "seconds": 0.1}
LONG = {"step": "nap", "name": "long", "seconds": 2.0}


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Harness]:
    with harness(tmp_path) as made:
        yield made


def test_a_killed_computation_runs_again(service: Harness) -> None:
    service.start_worker()
    job = service.submit([FIRST], [LONG])
    os.kill(service.started("long"), signal.SIGKILL)
    assert service.finished(job).status is JobStatus.SUCCESSFUL
    assert (len(service.events("start", "first")), len(service.events("end", "long"))) == (1, 1)


def test_after_everything_was_killed_the_job_goes_on_where_it_was(service: Harness) -> None:
    service.start_worker()
    job = service.submit([FIRST], [LONG])
    computing = service.started("long")
    service.kill_all()
    wait_until(lambda: not alive(computing), 2.0)
    service.start_worker()
    finished = service.finished(job)
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 2)
    assert (len(service.events("start", "first")), len(service.events("end", "long"))) == (1, 1)
    assert service.scratch_left() == []


@pytest.mark.e2e
def test_another_worker_takes_over_from_a_killed_one(service: Harness) -> None:
    first = service.start_worker("0")
    job = service.submit([FIRST], [LONG])
    service.started("long")
    service.start_worker("1")
    wait_until(lambda: service.queue.live_workers() == 2)
    first.kill()
    first.wait()
    assert service.finished(job).status is JobStatus.SUCCESSFUL
    assert (len(service.events("start", "first")), len(service.events("end", "long"))) == (1, 1)


@pytest.mark.e2e
def test_a_job_that_takes_its_worker_down_each_time_fails_and_says_where(service: Harness) -> None:
    job = service.submit([{**LONG, "seconds": 60}])
    for attempt in range(1, 4):
        service.start_worker()
        service.started("long", times=attempt)
        wait_until(lambda: "napping" in service.job(job).message)
        service.kill_all()
    service.start_worker()
    failed = service.finished(job)
    assert (failed.status, failed.attempts) == (JobStatus.FAILED, 3)
    assert "long: napping" in failed.message


@pytest.mark.e2e
def test_a_worker_that_stops_in_order_gives_its_step_back_without_counting(service: Harness) -> None:
    worker = service.start_worker()
    job = service.submit([FIRST], [LONG])
    computing = service.started("long")
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(10) == 0
    assert not alive(computing)
    service.start_worker()
    finished = service.finished(job)
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 1)


def launch(service: Harness) -> subprocess.Popen[bytes]:
    code = (
        "from service.launcher import serve; from service.settings import Settings; "
        "serve(Settings(), steps='engine_steps:STEPS', plans='engine_steps:PLANS', app='engine_app:app')"
    )
    with (service.settings.data_dir / "serve.log").open("ab") as log:
        launcher = subprocess.Popen(
            [sys.executable, "-c", code],
            env={**service.environment(), "TIELINE_PORT": "0"},
            stdout=subprocess.PIPE,
            stderr=log,
            cwd=HERE,
        )
    service.workers.append(launcher)
    return launcher


def family_of(launcher: subprocess.Popen[bytes], least: int) -> list[psutil.Process]:
    process = psutil.Process(launcher.pid)
    wait_until(lambda: len(process.children(recursive=True)) >= least)
    return process.children(recursive=True)


def test_sigterm_of_the_launcher_leaves_no_process(service: Harness) -> None:
    launcher = launch(service)
    assert launcher.stdout is not None
    announced = launcher.stdout.readline()
    service.submit([{**LONG, "seconds": 60}])
    service.started("long")
    family = family_of(launcher, 3)
    launcher.send_signal(signal.SIGTERM)
    code = launcher.wait(10)
    launcher.stdout.close()
    assert (announced[:28], code) == (b"Tieline is ready at http://1", 0)
    assert [each for each in family if alive(each.pid)] == []


@pytest.mark.e2e
def test_kill_of_the_launcher_leaves_no_process_and_its_restart_finishes_the_job(service: Harness) -> None:
    launcher = launch(service)
    job = service.submit([FIRST], [LONG])
    service.started("long")
    family = family_of(launcher, 3)
    launcher.kill()
    launcher.communicate()
    wait_until(lambda: not any(alive(each.pid) for each in family), 3.0)
    again = launch(service)
    finished = service.finished(job)
    again.terminate()
    again.communicate()
    assert (finished.status, len(service.events("start", "first"))) == (JobStatus.SUCCESSFUL, 1)


@pytest.mark.e2e
def test_the_launcher_restarts_a_worker_that_dies(service: Harness) -> None:
    launcher = launch(service)
    job = service.submit([FIRST], [LONG])
    computing = psutil.Process(service.started("long"))
    parent = computing.parent()
    assert parent is not None
    parent.kill()
    finished = service.finished(job)
    launcher.terminate()
    launcher.communicate()
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 2)
