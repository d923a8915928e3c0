"""Which jobs a list holds, as a condition of the database."""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import GenericFunction

from service.adapters.database.tables import UtcDateTime, jobs
from service.ports import JobFilter


class _SecondsBetween(GenericFunction[float]):
    """Seconds from the first time to the second."""

    type = sa.Float()
    name = "seconds_between"
    inherit_cache = True


@compiles(_SecondsBetween)
def _in_postgresql(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    begin, end = (compiler.process(each, **options) for each in element.clauses)
    return f"EXTRACT(EPOCH FROM ({end} - {begin}))"


@compiles(_SecondsBetween, "sqlite")
def _in_sqlite(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    begin, end = (compiler.process(each, **options) for each in element.clauses)
    return f"((julianday({end}) - julianday({begin})) * 86400.0)"


def condition_of(which: JobFilter) -> sa.ColumnElement[bool]:
    """Give the condition that the rows of matching jobs fulfil; the same as `JobFilter.admits`."""
    conditions: list[sa.ColumnElement[bool]] = []
    if which.statuses:
        conditions.append(jobs.c.status.in_([status.value for status in which.statuses]))
    if which.process_ids:
        conditions.append(jobs.c.process_id.in_(which.process_ids))
    if which.created_from is not None:
        conditions.append(jobs.c.created >= which.created_from)
    if which.created_before is not None:
        conditions.append(jobs.c.created < which.created_before)
    if which.asks_for_duration:
        end = sa.func.coalesce(jobs.c.finished, sa.literal(which.now, UtcDateTime))
        duration_s = _SecondsBetween(jobs.c.started, end)
        conditions.append(jobs.c.started.is_not(None))
        if which.min_duration_s is not None:
            conditions.append(duration_s >= which.min_duration_s)
        if which.max_duration_s is not None:
            conditions.append(duration_s <= which.max_duration_s)
    return sa.and_(sa.true(), *conditions)
