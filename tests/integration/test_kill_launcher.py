"""The launcher keeps workers alive, leaves no process, and finishes jobs after everything was killed."""

import subprocess
import sys
from collections.abc import Iterator

import psutil
import pytest
from engine_harness import HERE, Harness, alive, harness, wait_until

from service.ports import JobStatus

SHORT = {"step": "nap", "seconds": 0.1}
LONG = {"step": "nap", "seconds": 1.5}
SERVE = (
    "from service.launcher import serve; from service.settings import Settings; "
    "serve(Settings(), steps='engine_steps:STEPS', plans='engine_steps:PLANS', app='engine_app:app')"
)


pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Harness]:
    with harness(tmp_path_factory.mktemp("launched")) as made:
        yield made


def launched(service: Harness) -> psutil.Process:
    """Give the running launcher with its API process and its worker; start it when there is none."""
    if not service.workers or service.workers[-1].poll() is not None:
        with (service.settings.data_dir / "serve.log").open("ab") as log:
            launcher = subprocess.Popen(
                [sys.executable, "-c", SERVE],
                env={**service.environment(), "TIELINE_PORT": "0"},
                stdout=subprocess.PIPE,
                stderr=log,
                cwd=HERE,
            )
        service.workers.append(launcher)
        assert launcher.stdout is not None
        with launcher.stdout:
            assert launcher.stdout.readline().startswith(b"Tieline is ready at http://127.0.0.1:")
    wait_until(lambda: service.queue.live_workers() == 1)
    return psutil.Process(service.workers[-1].pid)


def test_a_worker_that_dies_is_started_again(service: Harness) -> None:
    launched(service)
    job = service.submit([{**SHORT, "name": "short"}], [{**LONG, "name": "long"}])
    worker = psutil.Process(service.started("long")).parent()
    assert worker is not None
    worker.kill()
    finished = service.finished(job)
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 2)
    assert (len(service.events("start", "short")), len(service.events("end", "long"))) == (1, 1)


def test_after_everything_was_killed_the_job_goes_on_where_it_was(service: Harness) -> None:
    launcher = launched(service)
    job = service.submit([{**SHORT, "name": "before"}], [{**LONG, "name": "after"}])
    service.started("after")
    family = launcher.children(recursive=True)
    launcher.kill()
    service.workers[-1].wait()
    wait_until(lambda: not any(alive(each.pid) for each in family), 3.0)
    launched(service)
    finished = service.finished(job)
    assert (finished.status, finished.attempts) == (JobStatus.SUCCESSFUL, 2)
    assert (len(service.events("start", "before")), len(service.events("end", "after"))) == (1, 1)
    assert service.scratch_left() == []


def test_sigterm_leaves_no_process(service: Harness) -> None:
    launcher = launched(service)
    service.submit([{**LONG, "name": "endless", "seconds": 60}])
    service.started("endless")
    family = launcher.children(recursive=True)
    launcher.terminate()
    assert (len(family), service.workers[-1].wait(10)) == (3, 0)
    assert [each for each in family if alive(each.pid)] == []
