"""Wait for a database that is away: jobs go on when it is back."""

import asyncio
import time
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import structlog
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as NoConnectionError

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.2, 5.0
AWAY = (OperationalError, InterfaceError, NoConnectionError)
"""Errors of a database that is away, starting, stopping, locked, busy, or has no connection left."""
DATABASE_ERRORS = (DBAPIError, NoConnectionError, OSError)
Parameters = ParamSpec("Parameters")
Value = TypeVar("Value")
log = structlog.get_logger()


def is_away(error: Exception) -> bool:
    """Tell whether an error may pass when the same is tried again."""
    return isinstance(error, AWAY) or (isinstance(error, DBAPIError) and error.connection_invalidated)


def words_of(error: Exception) -> str:
    """Give the database's own words, without statement and values."""
    return str(error.orig).strip() if isinstance(error, DBAPIError) else str(error)


def patiently_at_once(within_s: float, function: Callable[[], Value]) -> Value:
    """Do something with the database in this thread, again and again while it is away; see `patiently`."""
    pause_s, deadline = FIRST_PAUSE_S, time.monotonic() + within_s
    while True:
        try:
            return function()
        except (DBAPIError, NoConnectionError) as error:
            _require_hope(error, deadline)
        time.sleep(pause_s)
        pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)


async def patiently(
    within_s: float, function: Callable[Parameters, Value], *arguments: Parameters.args, **named: Parameters.kwargs
) -> Value:
    """Do something with the database in a thread, again and again while it is away.

    What is done must do no harm when it is done twice: it may have happened although the answer was lost.

    Parameters
    ----------
    within_s
        After so long, the error counts.
    function, arguments, named
        What to do.
    """
    pause_s, deadline = FIRST_PAUSE_S, time.monotonic() + within_s
    while True:
        try:
            return await asyncio.to_thread(function, *arguments, **named)
        except (DBAPIError, NoConnectionError) as error:
            _require_hope(error, deadline)
        await asyncio.sleep(pause_s)
        pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)


def _require_hope(error: Exception, deadline: float) -> None:
    """Raise what will not pass, or has lasted too long."""
    if not is_away(error) or time.monotonic() > deadline:
        raise error
    log.warning("the database does not answer; tried again", error=words_of(error))
