"""Which jobs a client wants to see (OGC API - Processes 1.0, 11.2)."""

import re
from dataclasses import dataclass
from datetime import UTC, timedelta
from datetime import datetime as Moment  # noqa: N812 - a query parameter is called datetime
from typing import Annotated

from fastapi import Depends, Query
from pydantic import Field

from service.errors import FieldFault, InvalidRequestError
from service.names.identifiers import is_identifier
from service.ports import JobFilter, JobStatus
from service.routes.paging import WHOLE, LimitParameter, OffsetParameter, page_size

TYPES = ("process",)
BEGUN = (JobStatus.RUNNING, JobStatus.SUCCESSFUL, JobStatus.FAILED, JobStatus.DISMISSED)
"""Of these only a duration can be told."""
LONGEST_S = 10**10
TIME = re.compile(r"\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d(\.\d{1,9})?([Zz]|[+-]\d\d:\d\d)")
"""A date-time of RFC 3339, 5.6."""

TypeParameter = Annotated[list[str], Query(description="Only jobs of this type; there is only `process`.")]
StatusParameter = Annotated[
    list[str], Query(description="Only jobs of this status; several, also separated by commas.")
]
ProcessParameter = Annotated[
    list[str], Query(alias="processID", description="Only jobs of this process; several, also separated by commas.")
]
DatetimeParameter = Annotated[
    str | None,
    Query(
        description="Only jobs created then: a time as in RFC 3339, or an interval `begin/end`; `..` or nothing leaves "
        "it open."
    ),
]
Seconds = Annotated[int, Field(ge=0, le=LONGEST_S), WHOLE]
MinDurationParameter = Annotated[
    Seconds | None, Query(alias="minDuration", description="Only jobs that have run at least so long [s].")
]
MaxDurationParameter = Annotated[
    Seconds | None, Query(alias="maxDuration", description="Only jobs that have run at most so long [s].")
]


@dataclass(frozen=True)
class JobQuery:
    """What was asked for."""

    which: JobFilter
    repeated: dict[str, list[str]]
    """Parameters that links to other pages repeat."""
    hopeless: bool
    """Whether nothing can match."""


async def _job_query(
    limit: LimitParameter = 100,
    offset: OffsetParameter = 0,
    type: TypeParameter = [],  # noqa: A002, B006 - the parameter's name; the framework copies it
    status: StatusParameter = [],  # noqa: B006
    process_id: ProcessParameter = [],  # noqa: B006
    datetime: DatetimeParameter = None,
    min_duration: MinDurationParameter = None,
    max_duration: MaxDurationParameter = None,
) -> JobQuery:
    types, statuses = _known(type, TYPES, "type"), _known(status, [each.value for each in JobStatus], "status")
    processes = _separated(process_id)
    begin, end = _interval(datetime)
    timed = min_duration is not None or max_duration is not None
    which = JobFilter(
        statuses=tuple(JobStatus(each) for each in statuses) or (BEGUN if timed else ()),
        process_ids=tuple(process for process in processes if is_identifier(process)),
        limit=page_size(limit),
        offset=offset,
        created_from=begin,
        created_before=end,
        min_duration_s=min_duration,
        max_duration_s=max_duration,
        now=Moment.now(UTC),
    )
    given = {"datetime": datetime, "minDuration": min_duration, "maxDuration": max_duration}
    repeated = {"type": types, "status": statuses, "processID": list(which.process_ids)}
    repeated |= {name: [str(value)] for name, value in given.items() if value is not None}
    return JobQuery(which, repeated, hopeless=bool(processes) and not which.process_ids)


JobQueryDependency = Annotated[JobQuery, Depends(_job_query)]


def _separated(values: list[str]) -> list[str]:
    return [piece for value in values for piece in value.split(",") if piece]


def _known(values: list[str], known: list[str] | tuple[str, ...], name: str) -> list[str]:
    wanted = _separated(values)
    if not set(known).issuperset(wanted):
        raise _wrong(name, f"a {name} is one of {', '.join(sorted(known))}")
    return wanted


def _interval(text: str | None) -> tuple[Moment | None, Moment | None]:
    """Give first moment and end; a time without fractions is the whole second."""
    if text is None:
        return None, None
    begin, slash, end = text.partition("/")
    if not slash:
        begin = end = text
    if {begin, end} <= {"", ".."}:
        raise _wrong("datetime", "an interval has a begin or an end")
    first = None if begin in {"", ".."} else _time(begin)[0]
    return first, None if end in {"", ".."} else _end_of(*_time(end))


def _time(text: str) -> tuple[Moment, timedelta]:
    """Give a time and how long it lasts as it is written."""
    found = TIME.fullmatch(text)
    if found is None:
        raise _wrong("datetime", f"'{text[:60]}' is no time as in 2026-01-31T12:00:00Z")
    try:
        moment = Moment.fromisoformat(text.upper())
    except ValueError as fault:
        raise _wrong("datetime", f"'{text[:60]}': {fault}") from None
    return moment, timedelta(microseconds=1) if found[1] else timedelta(seconds=1)


def _end_of(moment: Moment, lasts: timedelta) -> Moment | None:
    try:
        return moment + lasts
    except OverflowError:  # the end of the year 9999
        return None


def _wrong(name: str, detail: str) -> InvalidRequestError:
    return InvalidRequestError(detail, [FieldFault(f"/query/{name}", detail)])
