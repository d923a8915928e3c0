"""A PostgreSQL server that is stopped, or cut off, says nothing: whoever asks it stops waiting by himself."""

import threading
import time
from collections.abc import Callable, Generator
from functools import partial
from typing import Any

import psycopg
import sqlalchemy as sa

CONNECTS_WITHIN_S = 5
"""Longest time for a new connection, and for the answer of one that has not been used for a while [s]."""
PAUSE_S = 1.0
"""Between two attempts to connect to a server that was silent [s]."""
ANSWERS_WITHIN_S = 15.0
"""Longest silence of a server that is asked something; longer than it lets a statement last [s]."""


class SilentServerError(psycopg.OperationalError):
    """State that a server said nothing for too long; its connection is closed."""


class TimelyConnection(psycopg.Connection[Any]):
    """A connection whose server is given up when it is silent."""

    outage: "Outage"
    within_s: float

    def wait(self, gen: Generator[Any, Any, Any], *arguments: Any, **named: Any) -> Any:
        """Drive one exchange with the server.

        Raises
        ------
        SilentServerError
            Nothing came for too long.
        """
        try:
            return super().wait(_heard(gen, self.within_s), *arguments, **named)
        except SilentServerError:
            self.outage.begin()
            self.pgconn.finish()
            raise


class Outage:
    """Refuse at once who wants to connect to a silent server; find out when it speaks again.

    Else each request would wait for itself, and with it a thread and all that is behind it.

    Parameters
    ----------
    speaks
        Connects to the server. Returns False when it is silent.
    """

    def __init__(self, speaks: Callable[[], bool]) -> None:
        self._speaks = speaks
        self._silent, self._over = False, threading.Event()
        self._lock = threading.Lock()

    def begin(self) -> None:
        """Note that the server is silent."""
        with self._lock:
            if not self._silent and not self._over.is_set():
                self._silent = True
                threading.Thread(target=self._listen, name="silent server", daemon=True).start()

    def end(self) -> None:
        """Stop asking, for good."""
        self._over.set()

    def require_none(self) -> None:
        """Let through who wants to connect.

        Raises
        ------
        SilentServerError
            The server was silent when it was last asked.
        """
        if self._silent:
            raise SilentServerError("the server was silent a moment ago")

    def _listen(self) -> None:
        while not self._over.wait(PAUSE_S) and not self._speaks():
            pass
        self._silent = False


def give_up_when_silent(engine: sa.Engine, within_s: float) -> None:
    """Let the connections of an engine give up a server that is silent for so long [s]."""
    arguments, named = engine.dialect.create_connect_args(engine.url)
    outage = Outage(partial(_speaks, *arguments, **{**named, "connect_timeout": CONNECTS_WITHIN_S}))

    @sa.event.listens_for(engine, "do_connect")
    def _connect(_dialect: sa.Dialect, _record: Any, arguments: Any, named: Any) -> TimelyConnection:
        outage.require_none()
        try:
            connection = TimelyConnection.connect(*arguments, **named)
        except psycopg.errors.ConnectionTimeout:
            outage.begin()
            raise
        connection.outage, connection.within_s = outage, within_s
        return connection

    @sa.event.listens_for(engine, "engine_disposed")
    def _end(_engine: sa.Engine) -> None:
        outage.end()


def ping(engine: sa.Engine, connection: Any) -> None:
    """Ask whether the server of a connection is still there; wait no longer than for a new one."""
    usual, connection.within_s = connection.within_s, float(CONNECTS_WITHIN_S)
    engine.dialect.do_ping(connection)
    connection.within_s = usual


def _speaks(*arguments: Any, **named: Any) -> bool:
    """Check whether a server says anything to who connects, though it were a refusal."""
    try:
        psycopg.connect(*arguments, **named).close()
    except psycopg.errors.ConnectionTimeout:
        return False
    except psycopg.Error:
        return True
    return True


def _heard(gen: Generator[Any, Any, Any], within_s: float) -> Generator[Any, Any, Any]:
    """Pass on the steps of an exchange, asked for several times a second, until nothing comes for too long."""
    heard, ready = time.monotonic(), None
    try:
        while True:
            ready = yield gen.send(ready)
            now = time.monotonic()
            if ready:
                heard = now
            elif now - heard > within_s:
                raise SilentServerError(f"the server was silent for {within_s:g} s")
    except StopIteration as done:
        return done.value
