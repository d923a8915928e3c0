"""Where single jobs stand, which is asked for more often than all else together: read as quickly as each database can.

A row of the embedded database is read by its key in some millionths of a second, from memory and beside writers. To
hand that to a thread would take twenty times as long, and far longer where threads write uploads at the same time:
they take turns with the interpreter, and those who ask wait in a queue that grows. A database that has to be waited for
is asked in one thread, for all jobs at once that were asked for in the meantime.
"""

import asyncio
import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import sqlalchemy as sa

from service.adapters.database.tables import connect_reader, jobs
from service.ports import JobState, JobStatus

NAMES = (*(each.name for each in fields(JobState)), "owner")
COLUMNS = sa.select(*(jobs.c[name] for name in NAMES))
ONE = COLUMNS.where(jobs.c.id == sa.bindparam("id"))
SEVERAL = COLUMNS.where(jobs.c.id.in_(sa.bindparam("ids", expanding=True)))
Row = Sequence[Any]


class DatabaseJobStates:
    """Tell where jobs stand.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._at_once = EmbeddedReader(engine) if engine.dialect.name == "sqlite" else None
        self._patiently = PatientReader(engine)

    async def look(self, job_id: str, owner: str | None) -> JobState | None:
        """Tell where a job of a project stands; owner None: of any project."""
        row = await self._row(job_id)
        if row is None or owner not in {None, row[-1]}:
            return None
        known = dict(zip(NAMES[:-1], row, strict=False))
        return JobState(**{**known, "status": JobStatus(known["status"])})

    async def _row(self, job_id: str) -> Row | None:
        if self._at_once is not None:
            try:
                return self._at_once.row(job_id)
            except (sqlite3.Error, sa.exc.DBAPIError):
                pass  # locked, full or damaged: who waits for it, and says what is wrong, waits in a thread
        return await self._patiently.row(job_id)


class PatientReader:
    """Read rows in one thread, all that are asked for while it reads together after that.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        embedded = engine.dialect.name == "sqlite"
        # a single statement needs no transaction, of which beginning and end would be two more questions to a server
        options: dict[str, Any] = {"reads_only": True} if embedded else {"isolation_level": "AUTOCOMMIT"}
        self._engine = engine.execution_options(**options)
        self._wanted: dict[str, asyncio.Future[Row | None]] = {}
        self._reading: asyncio.Task[None] | None = None

    async def row(self, job_id: str) -> Row | None:
        """Read the row of a job, as it is now or later.

        Raises
        ------
        sqlalchemy.exc.SQLAlchemyError
            The database does not answer.
        """
        wanted = self._wanted.setdefault(job_id, asyncio.get_running_loop().create_future())
        if self._reading is None or self._reading.done():
            self._reading = asyncio.create_task(self._read())
        return await asyncio.shield(wanted)

    async def _read(self) -> None:
        try:
            while self._wanted:
                wanted, self._wanted = self._wanted, {}
                await self._answer(wanted)
        finally:
            _end(self._wanted)

    async def _answer(self, wanted: "dict[str, asyncio.Future[Row | None]]") -> None:
        try:
            rows = await asyncio.to_thread(self._rows, tuple(wanted))
            for job_id, future in wanted.items():
                future.set_result(rows.get(job_id))
        except sa.exc.SQLAlchemyError as error:
            for future in wanted.values():
                future.set_exception(error)
                future.exception()  # all who asked may have gone
        finally:
            _end(wanted)

    def _rows(self, ids: Sequence[str]) -> dict[str, Row]:
        with self._engine.connect() as connection:
            return {row.id: row for row in connection.execute(SEVERAL, {"ids": ids})}


def _end(unanswered: "dict[str, asyncio.Future[Row | None]]") -> None:
    """Let nobody wait for what will never come, because the reading itself was ended."""
    for future in unanswered.values():
        future.cancel()
    unanswered.clear()


class EmbeddedReader:
    """Read rows of the embedded database without waiting for anything.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._reader = connect_reader(engine)
        self._statement = str(ONE.compile(dialect=engine.dialect))
        types = (jobs.c[name].type.dialect_impl(engine.dialect) for name in NAMES)
        self._readers: tuple[Callable[[Any], Any], ...] = tuple(
            each.result_processor(engine.dialect, None) or _as_it_is for each in types
        )

    def row(self, job_id: str) -> Row | None:
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
