"""Every process of the service is killed in every step of a registration, on each database: nothing is lost.

``TIELINE_KILLS`` is the number of random kills, 2 by default; from 100 on, the matrix is complete too, and `-k` takes a
part of it. Computation, worker and everything are also killed in `test_kill_during_registration`.
"""

import os
import random
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pytest

from service.formats.writers import write_scans
from tests.e2e.running.virtual_scans import simulate
from tests.integration.attacked_service import STEPS, AttackedService, attacked_service, victims_beside

pytestmark = pytest.mark.service

KILLS = int(os.environ.get("TIELINE_KILLS", "2"))
COMPLETE = KILLS >= 100
JOBS_AT_ONCE = 3 if COMPLETE else 1
PLACES = [step for step in STEPS if step != "features of S2"]
"""Features of both stations are computed side by side."""
SMALL = {
    "sqlite": [("api", 0), ("in_order", 1), ("life_of_worker", 0), ("breath_of_worker", 1)],
    "postgresql": [("worker", 2), ("api", 1), ("everything", 0), ("database", 0), ("database", 1)],
}
"""What is done where in the small matrix; computations are killed in `test_kill_during_registration`."""
Services = Callable[[str], AttackedService]
"""Give the service on a kind of database."""
SPARED = {"computation", "api", "in_order", "breath_of_worker", "database"}
"""Those whose worker lives, or stopped in order, are not attempts of the job."""


def cells() -> list[tuple[str, str, str]]:
    """Give database, victim and step of each cell of the matrix."""
    if COMPLETE:
        return [(kind, victim, step) for kind in SMALL for victim in victims_beside(kind) for step in PLACES]
    return [(kind, victim, PLACES[place]) for kind, found in SMALL.items() for victim, place in found]


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scans") / "house.e57"
    write_scans(path, simulate("house"))
    return path


STOPPED_LATE = ("stopping takes too long", "did not stop in time", "steps are not handed over")
"""What the log says where a busy machine did not let a service stop in order in time: it died, and that counts."""


@pytest.fixture(scope="module")
def services(tmp_path_factory: pytest.TempPathFactory, scans: Path) -> Iterator[Services]:
    """Run a service for each kind of database, from the first test that wants it to the end of all."""
    with ExitStack() as running:
        yield cache(lambda kind: running.enter_context(attacked_service(tmp_path_factory.mktemp(kind), kind, scans)))


@pytest.mark.parametrize(("kind", "victim", "step"), cells())
def test_whatever_is_killed_wherever_the_job_ends_right_and_no_finished_step_is_repeated(
    services: Services, kind: str, victim: str, step: str
) -> None:
    service = services(kind)
    job = service.register_up_to(step)
    begin, said_before = time.monotonic(), len(service.running.log)
    service.attack(victim)
    faults = service.faults_of(job)
    print(f"{victim} during '{step}': done after {time.monotonic() - begin:.1f} s")
    assert faults == []
    if victim in SPARED and not any(words in service.running.log[said_before:] for words in STOPPED_LATE):
        assert service.attempts_of(job) == 1


@pytest.mark.parametrize("kind", SMALL)
@pytest.mark.timeout(1800)
def test_random_kills_lose_nothing_and_leave_nothing(services: Services, kind: str) -> None:
    service = services(kind)
    rng = random.Random(6)
    victims = victims_beside(kind)
    jobs = [service.register() for _ in range(JOBS_AT_ONCE)]
    begin = time.monotonic()
    for _ in range(KILLS):
        time.sleep(rng.expovariate(1.0 / 2.0))
        victim = rng.choice(victims)
        print(f"{time.monotonic() - begin:.1f} s: {victim}")
        service.attack(victim)
        running = [job for job in jobs if service.job(job)["status"] in {"accepted", "running"}]
        jobs += [service.register() for _ in range(JOBS_AT_ONCE - len(running))]
    faults = [fault for job in jobs for fault in service.faults_of(job)]
    print(f"{KILLS} kills, {len(jobs)} jobs, {time.monotonic() - begin:.0f} s, faults: {faults}")
    assert faults == []
    assert service.strays([job["jobID"] for job in service.ask("GET", "/jobs?limit=1000").json()["jobs"]]) == []
