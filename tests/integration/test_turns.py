"""Who comes first: urgent jobs, and projects in turn."""

from collections.abc import Iterator
from itertools import pairwise

import pytest
from engine_harness import Harness, harness, wait_until

from tests.servers.databases import NewDatabase

pytestmark = pytest.mark.service

NAP = {"step": "nap", "seconds": 0.8}
MANY = ("many-0", "many-1", "many-2")


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, new_database: NewDatabase) -> Iterator[Harness]:
    """Run one worker with two slots; of each project, one job at a time."""
    place = tmp_path_factory.mktemp("turns")
    with harness(place, database_url=new_database(), slots=2, max_running_jobs=1) as made:
        made.start_worker()
        wait_until(lambda: made.queue.live_workers() == 1)
        yield made


def moments(service: Harness, event: str, *names: str) -> list[float]:
    return [float(service.events(event, name)[0][3]) for name in names]


def test_a_project_with_many_jobs_does_not_keep_others_waiting(service: Harness) -> None:
    jobs = [service.submit([{**NAP, "name": name}], owner="many") for name in MANY]
    jobs.append(service.submit([{**NAP, "name": "few-0"}], owner="few"))
    for job in jobs:
        service.finished(job)
    spans = sorted(zip(*(moments(service, event, *MANY) for event in ("start", "end")), strict=True))
    assert all(end < begin for (_, end), (begin, _) in pairwise(spans))
    assert moments(service, "start", "few-0")[0] < spans[1][0]


def test_of_waiting_jobs_the_urgent_ones_come_first(service: Harness) -> None:
    blocker = service.submit([{**NAP, "name": "blocker", "seconds": 2.0}])
    service.started("blocker")
    urgencies = {"later": 6, "usual": 3, "now": 0}
    jobs = [service.submit([{**NAP, "name": name}], urgency=urgency) for name, urgency in urgencies.items()]
    for job in (blocker, *jobs):
        service.finished(job)
    starts = moments(service, "start", "now", "usual", "later")
    assert starts == sorted(starts)
