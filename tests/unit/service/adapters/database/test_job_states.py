"""Where single jobs stand, read from the embedded database without a thread."""

import asyncio
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy.exc import OperationalError

from service.adapters.database.job_states import PatientReader
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect
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
    store = DatabaseJobStore(engine)
    made = Job("a", "register", {"stations": []}, JobStatus.ACCEPTED, created=NOW, file_ids=("f",), owner="bridge")
    store.create_and_enqueue(made)
    return store


def look(jobs: DatabaseJobStore, job_id: str) -> JobState | None:
    return asyncio.run(jobs.look(job_id))


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


def test_what_is_asked_for_while_a_slow_database_answers_is_read_together(
    jobs: DatabaseJobStore, engine: sa.Engine
) -> None:
    for number in range(20):
        jobs.create_and_enqueue(Job(f"n{number}", "register", {}, JobStatus.ACCEPTED, created=NOW))
    statements: list[str] = []
    sa.event.listen(engine, "before_cursor_execute", lambda *said: statements.append(said[2]))

    async def asked() -> list[Any]:
        reader = PatientReader(engine)
        asking = [asyncio.create_task(reader.row("a"))]
        await asyncio.sleep(0)  # the first reading has begun
        asking += [asyncio.create_task(reader.row(f"n{number}")) for number in range(21)]
        return [row and row[0] for row in await asyncio.gather(*asking)]

    assert asyncio.run(asked()) == ["a", *(f"n{number}" for number in range(20)), None]
    assert len([each for each in statements if each.startswith("SELECT")]) == 2


def test_all_who_wait_hear_that_the_database_does_not_answer(jobs: DatabaseJobStore, engine: sa.Engine) -> None:
    del jobs
    with engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE jobs")

    async def asked() -> list[Any]:
        reader = PatientReader(engine)
        return await asyncio.gather(*(reader.row(f"n{number}") for number in range(5)), return_exceptions=True)

    assert [type(each) for each in asyncio.run(asked())] == 5 * [OperationalError]
