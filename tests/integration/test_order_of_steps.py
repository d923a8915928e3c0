"""What is begun is finished: jobs end one after the other, and those that wait say so."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from engine_harness import Harness, harness, wait_until

from service.ports import JobFilter, JobStatus
from tests.servers.databases import NewDatabase

pytestmark = [pytest.mark.service, pytest.mark.timeout(900)]

NAP = {"step": "nap", "seconds": 0.4}
WITHIN_S = 600.0
SLOTS = 2


@pytest.fixture
def service(tmp_path: Path, new_database: NewDatabase) -> Iterator[Harness]:
    with harness(tmp_path, database_url=new_database(), slots=SLOTS) as made:
        yield made


def three_stages(service: Harness, name: str, **of_job: object) -> str:
    stages = [[{**NAP, "name": f"{name}-{stage}-{k}"} for k in range(width)] for stage, width in enumerate((2, 1, 1))]
    return service.submit(*stages, **of_job)


def test_of_twelve_equal_jobs_the_first_ends_early_and_only_those_run_of_which_steps_run(service: Harness) -> None:
    jobs = [three_stages(service, f"j{number}") for number in range(12)]
    service.start_worker()
    most_running = 0

    def over() -> bool:
        nonlocal most_running
        _, number = service.jobs.find(JobFilter(statuses=(JobStatus.RUNNING,)))
        most_running = max(most_running, number)
        return all(service.job(job).status.finished for job in jobs)

    wait_until(over, WITHIN_S, every_s=0.05)
    names = [words[1] for words in service.events("end")]
    ends = [names.index(f"j{number}-2-0") for number in range(12)]
    # of 48 steps the first job has four, and the slot beside it begins with the next job
    assert ends[0] < 8
    assert max(abs(ends[number] - 4 * (number + 1)) for number in range(12)) <= 4
    # one whose step has just ended may be seen before its slot has gone to another
    assert most_running <= SLOTS + 1


def test_under_a_flood_of_one_project_another_begins_within_the_time_of_two_steps(service: Harness) -> None:
    flood = [three_stages(service, f"flood{number}", owner="flood") for number in range(40)]
    service.start_worker()
    wait_until(lambda: len(service.events("end")) >= 4, WITHIN_S)
    other = three_stages(service, "other", owner="other", urgency=7)
    begun = len(service.events("start"))
    service.finished(other, WITHIN_S)
    order = [words[1] for words in service.events("start")]
    # two steps' time: what the slots had taken before, and may not have told yet, and one step more of each
    assert next(place for place, name in enumerate(order) if name.startswith("other")) - begun <= 2 * SLOTS
    for job in flood:
        service.jobs.dismiss(job, service.job(job).created)
