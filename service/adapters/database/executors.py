"""Which workers live: one row per worker, touched by its heartbeat where there are several."""

import os
import time
from collections.abc import Sequence

import psutil
import sqlalchemy as sa

from service.adapters.database.tables import executors, leases
from service.adapters.processes.process_limits import this_host
from service.ports import DeadExecutor

DEAD_AFTER_S = 6.0
"""Three heartbeats missed."""


class DatabaseExecutors:
    """Keep the workers and named leases. Times are those of the database machine.

    Parameters
    ----------
    engine
        From `connect`.
    several
        Whether there may be several workers, whose hearts beat; None: where the database is a server.
    """

    def __init__(self, engine: sa.Engine, *, several: bool | None = None) -> None:
        self._engine = engine
        self._host = this_host()
        self._several = engine.dialect.name == "postgresql" if several is None else several

    def register(self, executor_id: str, launcher: int | None = None) -> None:
        """Enter a worker, and the process that keeps it running."""
        me = psutil.Process(os.getpid())
        started = None if launcher is None else psutil.Process(launcher).create_time()
        with self._engine.begin() as connection:
            connection.execute(
                sa.insert(executors).values(
                    id=executor_id,
                    host=self._host,
                    pid=me.pid,
                    process_started=me.create_time(),
                    heartbeat=clock(connection),
                    launcher_pid=launcher,
                    launcher_started=started,
                )
            )

    def beat(self, executor_id: str) -> bool:
        """Say that a worker lives; False when it was taken for dead meanwhile (it must stop at once)."""
        with self._engine.begin() as connection:
            change = sa.update(executors).where(executors.c.id == executor_id).values(heartbeat=clock(connection))
            return bool(connection.execute(change).rowcount)

    def remove(self, executor_id: str) -> None:
        """Strike out a worker that stops in order."""
        with self._engine.begin() as connection:
            connection.execute(sa.delete(executors).where(executors.c.id == executor_id))

    def bury_dead(self, executor_id: str, *, by_heart: bool = True) -> Sequence[DeadExecutor]:
        """Strike out workers whose process is gone or whose heart has not beaten for a while, except the caller.

        Where there is only one, all others are gone.
        """
        with self._engine.begin() as connection:
            overdue = clock(connection) - DEAD_AFTER_S
            rows = connection.execute(sa.select(executors).where(executors.c.id != executor_id)).all()
            silent = [by_heart and row.heartbeat < overdue for row in rows]
            judged = zip(rows, silent, strict=True)
            dead = [row for row, is_silent in judged if not self._several or is_silent or self._is_gone(row)]
            if dead:
                connection.execute(sa.delete(executors).where(executors.c.id.in_([row.id for row in dead])))
        return [DeadExecutor(row.id, self._launcher_is_gone(row)) for row in dead]

    def live(self) -> Sequence[str]:
        """List the workers that are entered and not overdue."""
        with self._engine.execution_options(reads_only=True).begin() as connection:
            beats = executors.c.heartbeat >= clock(connection) - DEAD_AFTER_S if self._several else sa.true()
            rows = connection.execute(sa.select(executors).where(beats)).all()
        return [row.id for row in rows if not self._is_gone(row)]

    def lease(self, name: str, holder: str, seconds: float) -> bool:
        """Take or keep a named lease; False while someone else holds it."""
        with self._engine.begin() as connection:
            now = clock(connection)
            # a worker that is gone holds nothing
            orphaned = leases.c.holder.not_in(sa.select(executors.c.id))
            held = sa.select(executors).join(leases, leases.c.holder == executors.c.id).where(leases.c.name == name)
            gone = [row.id for row in connection.execute(held) if self._is_gone(row)]
            free = sa.or_(leases.c.holder == holder, leases.c.expires < now, orphaned, leases.c.holder.in_(gone))
            values = {"holder": holder, "expires": now + seconds}
            if connection.execute(sa.update(leases).where(leases.c.name == name, free).values(values)).rowcount:
                return True
            if connection.execute(sa.select(leases.c.name).where(leases.c.name == name)).first() is not None:
                return False
            try:
                with connection.begin_nested():
                    connection.execute(sa.insert(leases).values(name=name, **values))
            except sa.exc.IntegrityError:
                return False  # someone else inserted it in between
            return True

    def _is_gone(self, row: sa.Row[tuple[object, ...]]) -> bool:
        """Tell whether a worker of this machine has no process any more, which is known without waiting."""
        return row.host == self._host and _has_ended(row.pid, row.process_started)

    def _launcher_is_gone(self, row: sa.Row[tuple[object, ...]]) -> bool:
        """Check whether it is known that the process that kept a worker running has ended too."""
        if row.launcher_pid is None:
            return False
        if row.host != self._host:
            return not self._several  # it was on this machine, before that was restarted
        return _has_ended(row.launcher_pid, row.launcher_started)


def _has_ended(pid: int, started: float) -> bool:
    try:
        process = psutil.Process(pid)
        return abs(process.create_time() - started) > 1.0 or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def clock(connection: sa.Connection) -> float:
    """Read the clock that all workers share (an embedded database is on this machine)."""
    if connection.dialect.name == "postgresql":
        return float(connection.execute(sa.select(present(connection))).scalar_one())
    return time.time()


def present(connection: sa.Connection) -> sa.ColumnElement[float]:
    """Give the reading of that clock as a part of a statement, which spares one of its own."""
    if connection.dialect.name == "postgresql":
        return sa.cast(sa.extract("epoch", sa.func.clock_timestamp()), sa.Float)
    return sa.literal(time.time())
