"""Where single jobs stand, which is asked for more often than all else together: read as quickly as each database can.

A row of the embedded database is read by its key in some millionths of a second, from memory and beside writers. To
hand that to a thread would take twenty times as long, and far longer where threads write uploads at the same time.
"""

import asyncio
import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import sqlalchemy as sa

from service.adapters.database_tables import connect_reader, jobs
from service.ports import JobState, JobStatus

NAMES = (*(each.name for each in fields(JobState)), "owner")
QUERY = sa.select(*(jobs.c[name] for name in NAMES)).where(jobs.c.id == sa.bindparam("id"))


class DatabaseJobStates:
    """Tell where jobs stand.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine
        self._at_once = EmbeddedReader(engine) if engine.dialect.name == "sqlite" else None

    async def look(self, job_id: str, owner: str | None) -> JobState | None:
        """Tell where a job of a project stands; owner None: of any project."""
        row = await self._row(job_id)
        if row is None or owner not in {None, row[-1]}:
            return None
        known = dict(zip(NAMES[:-1], row, strict=False))
        return JobState(**{**known, "status": JobStatus(known["status"])})

    async def _row(self, job_id: str) -> Sequence[Any] | None:
        if self._at_once is not None:
            try:
                return self._at_once.row(job_id)
            except (sqlite3.Error, sa.exc.DBAPIError):
                pass  # locked, full or damaged: who waits for it, and says what is wrong, waits in a thread
        return await asyncio.to_thread(self._patiently, job_id)

    def _patiently(self, job_id: str) -> Sequence[Any] | None:
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return connection.execute(QUERY, {"id": job_id}).one_or_none()


class EmbeddedReader:
    """Read rows of the embedded database without waiting for anything.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._reader = connect_reader(engine)
        self._statement = str(QUERY.compile(dialect=engine.dialect))
        types = (jobs.c[name].type.dialect_impl(engine.dialect) for name in NAMES)
        self._readers: tuple[Callable[[Any], Any], ...] = tuple(
            each.result_processor(engine.dialect, None) or _as_it_is for each in types
        )

    def row(self, job_id: str) -> Sequence[Any] | None:
        """Read the row of a job.

        Raises
        ------
        sqlite3.Error, sqlalchemy.exc.DBAPIError
            It cannot be read at once.
        """
        connection = self._reader.raw_connection()
        try:
            cursor = connection.cursor()
            cursor.execute(self._statement, (job_id,))
            rows = cursor.fetchall()
            cursor.close()
        finally:
            connection.close()
        return [read(value) for read, value in zip(self._readers, rows[0], strict=True)] if rows else None


def _as_it_is(value: Any) -> Any:
    return value
