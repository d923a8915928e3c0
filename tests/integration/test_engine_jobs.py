"""Jobs run in workers: order, progress, failures, limits, dismissal."""

import asyncio
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from engine_harness import Harness, alive, harness, wait_until

from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.files.object_files import blob_store
from service.adapters.processes.child_process import ChildProcesses
from service.errors import to_problem
from service.ports import JobStatus, StepFailedError
from service.settings import GIGABYTE, Settings
from tests.servers.databases import NewDatabase

pytestmark = pytest.mark.service

NAP = {"step": "nap", "seconds": 0.3}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, new_database: NewDatabase) -> Iterator[Harness]:
    """Run one worker with two slots for all tests of this file."""
    place = tmp_path_factory.mktemp("service")
    with harness(place, database_url=new_database(), slots=2, step_memory_bytes=GIGABYTE) as made:
        made.start_worker()
        wait_until(lambda: made.queue.live_workers() == 1)
        yield made


def test_two_jobs_run_side_by_side_to_their_end(service: Harness) -> None:
    jobs = [service.submit([{**NAP, "name": name, "seconds": 1.5}]) for name in ("left", "right")]
    finished = [service.finished(job) for job in jobs]
    starts = [float(service.events("start", name)[0][3]) for name in ("left", "right")]
    ends = [float(service.events("end", name)[0][3]) for name in ("left", "right")]
    assert ([job.status for job in finished], max(starts) < min(ends)) == ([JobStatus.SUCCESSFUL] * 2, True)


def test_progress_grows_over_all_stages_and_names_the_step(service: Harness) -> None:
    job = service.submit([{**NAP, "name": "first"}, {**NAP, "name": "second"}], [{**NAP, "name": "third"}])
    seen = []
    while not seen or not seen[-1].status.finished:
        seen.append(service.job(job))
        time.sleep(0.02)
    progress = [each.progress for each in seen]
    assert progress == sorted(progress)
    assert progress[-1] == 100
    assert len(set(progress)) > 4
    assert any(each.message.startswith("third: napping") for each in seen)


def test_a_stage_begins_after_the_one_before(service: Harness) -> None:
    service.finished(service.submit([{**NAP, "name": "before"}], [{**NAP, "name": "after"}]))
    assert float(service.events("end", "before")[0][3]) < float(service.events("start", "after")[0][3])


def test_what_a_job_has_stored_is_counted_when_it_succeeds(service: Harness) -> None:
    job = service.finished(service.submit([{"step": "store", "name": "stored", "bytes": 1000}]))
    assert (job.status, service.jobs.results_bytes()) == (JobStatus.SUCCESSFUL, 1000)


def test_an_error_that_a_step_reports_fails_the_job_at_once_with_the_same_problem(service: Harness) -> None:
    job = service.finished(service.submit([{"step": "refuse", "name": "refused"}]))
    assert (job.status, len(service.events("start", "refused"))) == (JobStatus.FAILED, 1)
    assert job.problem == {
        "type": "about:blank",
        "title": "Unusable input",
        "status": 400,
        "detail": "the scan: has no points",
    }


def test_the_log_of_a_job_tells_of_its_steps_and_how_long_they_took(service: Harness) -> None:
    job = service.submit([{**NAP, "name": "noted"}])
    service.finished(job)
    begun, done = DatabaseJobLog(service.engine).read(job, 10)
    assert begun.text == "noted: begun"
    assert re.fullmatch(r"noted: done in \d+\.\d s", done.text)


def test_the_log_of_a_failed_job_tells_why_but_no_details_of_the_implementation(service: Harness) -> None:
    refused, burst = (service.submit([{"step": step, "name": step}]) for step in ("refuse", "burst"))
    service.finished(refused)
    service.finished(burst)
    log = DatabaseJobLog(service.engine)
    assert log.read(refused, 10)[-1].text == "refuse: the scan: has no points"
    assert not any("secret" in line.text for line in log.read(burst, 10))


def test_an_unexpected_error_keeps_its_details_to_the_log(service: Harness) -> None:
    job = service.finished(service.submit([{"step": "burst", "name": "burst"}]))
    assert job.problem is not None
    assert (job.problem["status"], "secret" in job.message) == (500, False)
    assert "a secret of the implementation" in (service.settings.data_dir / "worker.log").read_text()


def test_a_fault_of_the_service_itself_fails_the_job_and_does_not_leave_it_waiting(service: Harness) -> None:
    job = service.finished(service.submit([{"step": "a step without a name breaks the plan"}]))
    assert job.problem is not None
    assert (job.status, job.problem["status"]) == (JobStatus.FAILED, 503)


def test_a_failing_step_stops_the_steps_beside_it(service: Harness) -> None:
    job = service.submit([{"step": "nap", "name": "beside", "seconds": 60}, {"step": "refuse", "name": "refusing"}])
    service.finished(job)
    pids = [int(words[2]) for words in service.events("start", "beside")]
    wait_until(lambda: not any(alive(pid) for pid in pids), 5.0)
    assert service.events("end", "beside") == []


def test_a_step_that_always_crashes_fails_the_job_with_its_last_words_after_three_attempts(service: Harness) -> None:
    job = service.finished(service.submit([{"step": "crash", "name": "crashing"}]))
    assert job.problem is not None
    assert len(service.events("start", "crashing")) == 3
    assert "SIGSEGV" in job.problem["detail"]
    assert "the roof is on fire" in job.problem["detail"]


def test_a_step_that_takes_too_much_memory_says_so(service: Harness) -> None:
    job = service.finished(service.submit([{"step": "hog", "name": "hog"}]))
    assert job.message == "the computation needs more than the 1 GB of memory it may use"


def test_dismissing_kills_the_computation_and_all_it_left_within_five_seconds(service: Harness) -> None:
    pids = service.settings.data_dir / "pids"
    job = service.submit([{"step": "nap-with-company", "name": "dismissed", "seconds": 60, "pids": str(pids)}])
    service.started("dismissed")
    family = [int(pid) for pid in pids.read_text().split()]
    service.jobs.dismiss(job, service.job(job).created)
    wait_until(lambda: not any(alive(pid) for pid in family), 5.0)
    wait_until(lambda: service.scratch_left() == [], 2.0)
    assert service.job(job).status is JobStatus.DISMISSED


def test_a_job_dismissed_while_it_waits_never_runs(service: Harness) -> None:
    blockers = [service.submit([{"step": "nap", "name": "blocker", "seconds": 1.5}]) for _ in range(2)]
    service.started("blocker", times=2)
    waiting = service.submit([{**NAP, "name": "never"}])
    service.jobs.dismiss(waiting, service.job(waiting).created)
    last = service.submit([{**NAP, "name": "last"}])
    for job in (*blockers, last):
        service.finished(job)
    assert (service.events("start", "never"), service.job(waiting).status) == ([], JobStatus.DISMISSED)


def test_a_step_outside_a_job_gives_its_result(tmp_path: Path) -> None:
    runner = ChildProcesses(Settings(data_dir=tmp_path, confine_children=False), blob_store, "engine_steps:STEPS")
    arguments = {"name": "alone", "seconds": 0.3, "trace": str(tmp_path / "trace")}
    heard: list[float] = []
    result = asyncio.run(
        runner.run("nap", arguments, timeout_s=100.0, on_progress=lambda fraction, _message: heard.append(fraction))
    )
    assert (result, heard == sorted(heard), len(heard) > 1) == ({"name": "alone"}, True, True)


def test_a_step_outside_a_job_that_takes_too_long_is_stopped_and_leaves_nothing(tmp_path: Path) -> None:
    runner = ChildProcesses(Settings(data_dir=tmp_path, confine_children=False), blob_store, "engine_steps:STEPS")
    arguments = {"name": "slow", "seconds": 60, "trace": str(tmp_path / "trace")}
    with pytest.raises(StepFailedError) as caught:
        asyncio.run(runner.run("nap", arguments, timeout_s=2.5))
    assert "longer than 2.5 s" in to_problem(caught.value)["detail"]
    assert list((tmp_path / "scratch").iterdir()) == []
