"""The condition of the database admits the jobs that `JobFilter.admits` admits."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect
from service.ports import Job, JobFilter, JobStatus, JobStore
from service.settings import Settings
from tests.servers.databases import NewDatabase

NOW = datetime(2026, 3, 4, 5, 6, 7, 891_234, tzinfo=UTC)
SECONDS = (0.0, 0.5, 1.0, 59.0, 86_400.0)
STATUSES = tuple(JobStatus)


def _some(rng: np.random.Generator, *choices: object) -> object:
    return choices[int(rng.integers(0, len(choices)))]


def job(number: int) -> Job:
    rng = np.random.default_rng(number)
    created = NOW - timedelta(seconds=float(rng.choice(SECONDS)))
    started = _some(rng, None, created)
    assert started is None or isinstance(started, datetime)
    finished = (
        None if started is None or rng.random() < 0.5 else started + timedelta(seconds=float(rng.choice(SECONDS)))
    )
    status = STATUSES[int(rng.integers(0, len(STATUSES)))]
    return Job(f"j{number}", str(rng.choice(["echo", "register"])), {}, status, created, started, finished, created)


def asked(number: int) -> JobFilter:
    rng = np.random.default_rng(10_000 + number)

    def perhaps(value: Any) -> Any:
        return value if rng.random() < 0.3 else None

    return JobFilter(
        statuses=STATUSES[: int(rng.integers(0, 3))],
        process_ids=("echo",)[: int(rng.integers(0, 2))],
        created_from=perhaps(NOW - timedelta(seconds=float(rng.choice(SECONDS)))),
        created_before=perhaps(NOW - timedelta(seconds=float(rng.choice(SECONDS)))),
        # between the durations that there are: those are not kept to the last bit
        min_duration_s=perhaps(float(rng.choice(SECONDS)) + 0.25),
        max_duration_s=perhaps(float(rng.choice(SECONDS)) + 0.25),
        now=NOW,
    )


@pytest.fixture
def jobs(tmp_path: Path, new_database: NewDatabase) -> Iterator[JobStore]:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    migrate(settings)
    engine = connect(settings)
    store = DatabaseJobStore(engine)
    for number in range(40):
        store.create_and_enqueue(job(number))
    yield store
    engine.dispose()


def test_the_database_admits_what_the_filter_admits(jobs: JobStore) -> None:
    every = [job(number) for number in range(40)]
    for which in map(asked, range(150)):
        found, total = jobs.find(which)
        expected = {each.id for each in every if which.admits(each)}
        assert ({each.id for each in found}, total) == (expected, len(expected)), which


def test_what_is_wanted_of_a_job_is_kept(jobs: JobStore) -> None:
    wanted = {"outputs": ["pairs"], "raw": True}
    jobs.create_and_enqueue(Job("wanted", "echo", {}, JobStatus.ACCEPTED, NOW, updated=NOW, wanted=wanted))
    kept, plain = jobs.get("wanted"), jobs.get("j0")
    assert kept is not None
    assert plain is not None
    assert (kept.wanted, plain.wanted) == (wanted, None)
