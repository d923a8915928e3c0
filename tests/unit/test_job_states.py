"""Where single jobs stand, read from the embedded database without a thread."""

import asyncio
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy.exc import OperationalError

from service.adapters.database import DatabaseJobStore, migrate
from service.adapters.database_tables import connect
from service.ports import Job, JobState, JobStatus
from service.settings import Settings

NOW = datetime(2026, 3, 1, 12, 30, 15, 250_000, UTC)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path)


@pytest.fixture
def engine(settings: Settings) -> Iterator[sa.Engine]:
    migrate(settings)
    made = connect(settings)
    yield made
    made.dispose()


@pytest.fixture
def jobs(engine: sa.Engine) -> DatabaseJobStore:
    store = DatabaseJobStore(engine, lambda _connection, _job: None)
    made = Job("a", "register", {"stations": []}, JobStatus.ACCEPTED, created=NOW, file_ids=("f",), owner="bridge")
    store.create_and_enqueue(made)
    return store


def look(jobs: DatabaseJobStore, job_id: str) -> JobState | None:
    return asyncio.run(jobs.look(job_id))


def known(job: Job | JobState | None) -> dict[str, Any]:
    return {each.name: getattr(job, each.name) for each in fields(JobState)}


@pytest.mark.parametrize("begun", [False, True])
def test_a_state_says_what_the_job_says(jobs: DatabaseJobStore, begun: bool) -> None:
    if begun:
        jobs.start("a", NOW)
        jobs.report("a", 40, "matching", NOW)
    assert known(look(jobs, "a")) == known(jobs.get("a"))


def test_nothing_is_told_of_a_job_that_there_is_not(jobs: DatabaseJobStore) -> None:
    assert look(jobs, "b") is None


def test_nothing_is_told_of_a_job_of_others(jobs: DatabaseJobStore) -> None:
    assert look(jobs.of("tower"), "a") is None
    assert look(jobs.of("bridge"), "a") is not None


def test_a_locked_database_is_waited_for_without_holding_others_up(
    jobs: DatabaseJobStore, engine: sa.Engine, settings: Settings
) -> None:
    async def looked_at_while_locked() -> tuple[JobState | None, bool]:
        engine.dispose()  # else nobody could lock readers out
        with closing(sqlite3.connect(settings.data_dir / "tieline.sqlite", isolation_level=None)) as other:
            other.execute("PRAGMA locking_mode=EXCLUSIVE")
            other.execute("BEGIN IMMEDIATE")
            looking = asyncio.create_task(jobs.look("a"))
            waited = not (await asyncio.wait({looking}, timeout=0.3))[0]
            other.execute("ROLLBACK")
        return await looking, waited

    state, waited = asyncio.run(looked_at_while_locked())
    assert waited
    assert state is not None


def test_a_damaged_database_is_an_error_that_is_answered(jobs: DatabaseJobStore, engine: sa.Engine) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE jobs")
    with pytest.raises(OperationalError):
        look(jobs, "a")
