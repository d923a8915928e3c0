"""What is to be told to subscribers of jobs, in the metadata database.

A row per job and event, entered in the transaction in which the job's status changes. A claim is the moment at which
the row is due again, and who has it; the number of the attempt tells a claim from all others of the same row.
"""

from collections.abc import Collection, Sequence
from datetime import datetime
from typing import Any
from urllib.parse import urlsplit

import sqlalchemy as sa

from service.adapters.database.executors import clock
from service.adapters.database.tables import callbacks, executors, jobs
from service.ports import CallbackEvent, ClaimedCallback, Job, JobStatus, Subscription
from service.use_cases.access.sealed_secrets import Seal, is_sealed

EVENTS = {
    JobStatus.RUNNING: CallbackEvent.IN_PROGRESS,
    JobStatus.SUCCESSFUL: CallbackEvent.SUCCESS,
    JobStatus.FAILED: CallbackEvent.FAILED,
    JobStatus.DISMISSED: CallbackEvent.FAILED,
}


def note_change(connection: sa.Connection, job: Job) -> None:
    """Enter what is to be told of the status that a job has got in this transaction."""
    if job.subscriber is None:
        return
    of_job = callbacks.c.job_id == job.id
    if job.status.finished:
        progress = callbacks.c.event == CallbackEvent.IN_PROGRESS.value
        connection.execute(sa.update(callbacks).where(of_job, progress).values(due=None))
    event = EVENTS[job.status]
    uri = Subscription.from_json(job.subscriber).uris.get(event)
    known = sa.select(callbacks.c.event).where(of_job, callbacks.c.event == event.value)
    if uri is not None and connection.execute(known).first() is None:
        row = {"job_id": job.id, "event": event.value, "uri": uri, "host": urlsplit(uri).hostname or ""}
        connection.execute(sa.insert(callbacks).values(**row, due=clock(connection), attempts=0, delivered=0))


def seal_old_secrets(engine: sa.Engine, seal: Seal | None) -> None:
    """Encrypt the secrets of subscribers that were kept as they were sent; forget those of whom nothing is due.

    Parameters
    ----------
    engine
        Of a database whose tables are up to date.
    seal
        Encrypts; None: they are forgotten, and what is due is signed as where there was none.
    """
    subscribed = sa.select(jobs.c.id, jobs.c.owner, jobs.c.subscriber).where(jobs.c.subscriber.is_not(None))
    with engine.begin() as connection:
        for job_id, owner, subscriber in connection.execute(subscribed).all():
            if is_sealed(subscriber["secret"]):
                continue
            kept = "" if seal is None else seal.sealed(subscriber["secret"], owner)
            changed = {"subscriber": {**subscriber, "secret": kept}}
            connection.execute(sa.update(jobs).where(jobs.c.id == job_id).values(changed))
            _forget_secret(connection, job_id)


def _forget_secret(connection: sa.Connection, job_id: str) -> None:
    """Forget the secret of a subscriber to whom nothing more is to be told."""
    ended = sa.and_(jobs.c.id == job_id, jobs.c.finished.is_not(None), jobs.c.subscriber.is_not(None))
    row = connection.execute(sa.select(jobs.c.subscriber).where(ended)).first()
    due = sa.select(callbacks.c.event).where(callbacks.c.job_id == job_id, callbacks.c.due.is_not(None))
    if row is not None and row[0]["secret"] and connection.execute(due).first() is None:
        changed = {"subscriber": {**row[0], "secret": ""}}
        connection.execute(sa.update(jobs).where(jobs.c.id == job_id).values(changed))


class DatabaseCallbacks:
    """Hand out what is to be told, each to one at a time. Times are those of the database machine.

    Parameters
    ----------
    engine
        From `service.adapters.database.tables.connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def claim(self, holder: str, limit: int, seconds: float, busy_hosts: Collection[str]) -> Sequence[ClaimedCallback]:
        """Take what is due, the longest due first; what a worker had that is gone is due at once."""
        left = sa.and_(callbacks.c.claimed_by.is_not(None), callbacks.c.claimed_by.not_in(sa.select(executors.c.id)))
        with self._engine.execution_options(reads_only=True).begin() as connection:
            # most of the time nothing is due, and nobody else has to wait while that is found out
            ready = self._ready(clock(connection), left, busy_hosts)
            if connection.execute(sa.select(callbacks.c.job_id).where(ready).limit(1)).first() is None:
                return []
        with self._engine.begin() as connection:
            now = clock(connection)
            query = sa.select(callbacks).where(self._ready(now, left, busy_hosts)).order_by(callbacks.c.due)
            rows = connection.execute(query.limit(limit).with_for_update(skip_locked=True)).mappings().all()
            for row in rows:
                values = {"due": now + seconds, "claimed_by": holder, "attempts": row["attempts"] + 1}
                this = sa.and_(callbacks.c.job_id == row["job_id"], callbacks.c.event == row["event"])
                connection.execute(sa.update(callbacks).where(this).values(values))
        return [
            ClaimedCallback(
                job_id=row["job_id"],
                event=CallbackEvent(row["event"]),
                uri=row["uri"],
                holder=holder,
                attempt=row["attempts"] + 1,
                delivered=row["delivered"],
                told=row["told"],
            )
            for row in rows
        ]

    def settle(self, claimed: ClaimedCallback) -> None:
        """Note that nothing more is to be told; nothing happens when somebody else has claimed it meanwhile.

        The secret of a subscriber who has been told all is forgotten.
        """
        self._end_claim(claimed, None)
        with self._engine.begin() as connection:
            _forget_secret(connection, claimed.job_id)

    def retry(self, claimed: ClaimedCallback, seconds: float) -> None:
        """Let the same be tried again after a time."""
        self._end_claim(claimed, seconds)

    def go_on(self, claimed: ClaimedCallback, seconds: float, told: datetime | None) -> None:
        """Let news be told after a time, with all attempts, unless the job has ended by then."""
        told_now = {} if told is None else {"told": told, "delivered": callbacks.c.delivered + 1}
        self._end_claim(claimed, seconds, attempts=0, **told_now)

    def _end_claim(self, claimed: ClaimedCallback, seconds: float | None, **values: Any) -> None:
        mine = sa.and_(
            callbacks.c.job_id == claimed.job_id,
            callbacks.c.event == claimed.event.value,
            callbacks.c.attempts == claimed.attempt,
            callbacks.c.claimed_by == claimed.holder,
        )
        with self._engine.begin() as connection:
            due: Any = None
            if seconds is not None:
                due = sa.case((callbacks.c.due.is_not(None), clock(connection) + seconds), else_=sa.null())
            connection.execute(sa.update(callbacks).where(mine).values(due=due, claimed_by=None, **values))

    @staticmethod
    def _ready(now: float, left: sa.ColumnElement[bool], busy_hosts: Collection[str]) -> sa.ColumnElement[bool]:
        ready = sa.and_(callbacks.c.due.is_not(None), sa.or_(callbacks.c.due <= now, left))
        return sa.and_(ready, callbacks.c.host.not_in(busy_hosts)) if busy_hosts else ready
