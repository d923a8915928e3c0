"""Every process of the service is killed in every step of a registration, on each database: nothing is lost.

``TIELINE_KILLS`` is the number of random kills, 2 by default; from 100 on, the matrix is complete too. Computation,
worker and everything are also killed in tests/e2e/test_kill_during_registration.py.
"""

import os
import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.formats.writers import write_scans
from tests.e2e.virtual_scans import simulate
from tests.integration.attacked_service import STEPS, AttackedService, attacked_service

pytestmark = pytest.mark.service

KILLS = int(os.environ.get("TIELINE_KILLS", "2"))
COMPLETE = KILLS >= 100
JOBS_AT_ONCE = 3 if COMPLETE else 1
PLACES = [step for step in STEPS if step != "features of S2"]
"""Features of both stations are computed side by side."""
CELLS = {
    "sqlite": [("api", 0), ("in_order", 1), ("life_of_worker", 0), ("breath_of_worker", 1)],
    "postgresql": [("worker", 2), ("api", 1), ("everything", 0), ("database", 0), ("database", 1)],
}
"""What is done where in the small matrix; computations are killed in tests/e2e/test_kill_during_registration.py."""


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scans") / "house.e57"
    write_scans(path, simulate("house"))
    return path


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def service(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, scans: Path
) -> Iterator[AttackedService]:
    with attacked_service(tmp_path_factory.mktemp(request.param), request.param, scans) as made:
        yield made


def cells(service: AttackedService) -> list[tuple[str, str]]:
    if COMPLETE:
        return [(victim, step) for victim in service.victims() for step in PLACES]
    return [(victim, PLACES[place]) for victim, place in CELLS["sqlite" if service.server is None else "postgresql"]]


@pytest.mark.timeout(1800)
def test_whatever_is_killed_wherever_the_job_ends_right_and_no_finished_step_is_repeated(
    service: AttackedService,
) -> None:
    faults: list[str] = []
    for victim, step in cells(service):
        job = service.register_up_to(step)
        begin = time.monotonic()
        service.attack(victim)
        found = service.faults_of(job)
        # those whose worker lives, or stopped in order, are not attempts of the job
        spared = victim in {"computation", "api", "in_order", "breath_of_worker", "database"}
        if spared and service.attempts_of(job) != 1:
            found = [*found, f"{service.attempts_of(job)} attempts"]
        print(f"{victim} during '{step}': done after {time.monotonic() - begin:.1f} s {found or ''}")
        faults += [f"{victim} during '{step}': {fault}" for fault in found]
    assert faults == []


@pytest.mark.timeout(1800)
def test_random_kills_lose_nothing_and_leave_nothing(service: AttackedService) -> None:
    rng = random.Random(6)
    jobs = [service.register() for _ in range(JOBS_AT_ONCE)]
    begin = time.monotonic()
    for _ in range(KILLS):
        time.sleep(rng.expovariate(1.0 / 2.0))
        victim = rng.choice(service.victims())
        print(f"{time.monotonic() - begin:.1f} s: {victim}")
        service.attack(victim)
        running = [job for job in jobs if service.job(job)["status"] in {"accepted", "running"}]
        jobs += [service.register() for _ in range(JOBS_AT_ONCE - len(running))]
    faults = [fault for job in jobs for fault in service.faults_of(job)]
    print(f"{KILLS} kills, {len(jobs)} jobs, {time.monotonic() - begin:.0f} s, faults: {faults}")
    assert faults == []
    assert service.strays([job["jobID"] for job in service.ask("GET", "/jobs?limit=1000").json()["jobs"]]) == []
