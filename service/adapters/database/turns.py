"""Whose turn it is, in the metadata database: the queue that workers ask."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

import sqlalchemy as sa

from service.adapters.database.changes import Changes
from service.adapters.database.executors import present
from service.adapters.database.jobs import UNFINISHED
from service.adapters.database.steps import OURS, RUNNING, STEPS_OF_JOBS, WAITING, begin_step, tell_waiting
from service.adapters.database.tables import job_steps, jobs, lock_name, turns
from service.ports import ClaimedStep, FreshJob, StepPlace
from service.use_cases.jobs.turns import HELD_BACK_S, ProjectShare, WaitingPlace, before, in_turn

BEGINNING = timedelta(seconds=2.0)
"""A job that one worker was told to begin is told to no other for so long: of many that begin the same job all but one
work in vain, hold up the turns of the rest, and with them are ever more of the same."""
UNPLANNED = tuple(sa.and_(jobs.c.planned == 0, jobs.c.status == status) for status in UNFINISHED)
"""By status: of each alone an index gives them in order."""


class DatabaseTurns:
    """Hand out steps in order.

    Parameters
    ----------
    engine
        From `connect`.
    max_running_jobs
        Most jobs of a project that are begun and not finished; more urgent ones come in besides.
    """

    def __init__(self, engine: sa.Engine, max_running_jobs: int) -> None:
        self._engine = engine
        self._reading = engine.execution_options(reads_only=True)
        self._max_running_jobs = max_running_jobs
        self._changes = Changes(engine)
        self._first_fresh_query = _first_fresh_query(max_running_jobs)

    def look(self) -> bool:
        """Check whether anything waits."""
        if not self._changes.may_be():
            return False
        found = self._waits()
        self._changes.note(new=found)
        return found

    def _waits(self) -> bool:
        steps = sa.exists(sa.select(sa.literal(1)).where(job_steps.c.state == WAITING))
        fresh = sa.exists(sa.select(sa.literal(1)).select_from(jobs).where(sa.or_(*UNPLANNED)))
        with self._reading.begin() as connection:
            return bool(connection.execute(sa.select(sa.or_(steps, fresh))).scalar())

    def take_turn(self, executor_id: str, now: datetime, *, alone: bool) -> ClaimedStep | FreshJob | None:
        """Claim the step whose turn it is, or tell which job is to be begun."""
        with self._engine.begin() as connection:
            lock_name(connection, "turns")
            for owner in in_turn(_shares(connection)):
                step, fresh = _first_step(connection, owner), self._first_fresh(connection, owner, now)
                if fresh is not None and (step is None or before(fresh, _place_in_line(step))):
                    connection.execute(sa.update(jobs).where(jobs.c.id == fresh.job_id).values(updated=now))
                    return FreshJob(fresh.job_id)
                if step is not None:
                    if step["deaths"] >= 1.0 and not alone:
                        return None  # nobody else begins meanwhile, so that it will be alone soon
                    return _claim(connection, executor_id, step, now)
        return None

    def _first_fresh(self, connection: sa.Connection, owner: str, now: datetime) -> WaitingPlace | None:
        """Find the next job of a project that is to be begun and nobody begins, unless enough of them are under way."""
        values = {"owner": owner, "earliest": now - BEGINNING, "latest": now + BEGINNING}
        row = connection.execute(self._first_fresh_query, values).one_or_none()
        if row is None or row.number >= self._max_running_jobs:
            return None
        return WaitingPlace(row.urgency, 0, row.created, row.id)


def _owners(which: sa.ColumnElement[bool]) -> sa.Select[Any]:
    """Ask for the projects that have some of the jobs, from one to the next by an index: O(projects), not O(jobs)."""
    first = sa.select(jobs.c.owner).where(which).order_by(jobs.c.owner).limit(1)
    found = sa.select(first.subquery().c.owner).cte(recursive=True)
    following = first.where(jobs.c.owner > found.c.owner).correlate(found).scalar_subquery()
    found = found.union_all(sa.select(following).where(found.c.owner.is_not(None)))
    return sa.select(found.c.owner).where(found.c.owner.is_not(None))


OWNERS_OF_FRESH = sa.union_all(*map(_owners, UNPLANNED))


def _shares(connection: sa.Connection) -> Sequence[ProjectShare]:
    """Return the projects of which something waits, and what each of them has."""
    runs, waits = (sa.func.sum(sa.case((job_steps.c.state == state, 1), else_=0)) for state in (RUNNING, WAITING))
    steps = sa.select(jobs.c.owner, runs.label("running"), waits.label("waiting")).select_from(STEPS_OF_JOBS)
    unfinished = steps.where(OURS, job_steps.c.state.in_((RUNNING, WAITING))).group_by(jobs.c.owner)
    rows = connection.execute(unfinished).all()
    running, waiting = {row.owner: row.running for row in rows}, {row.owner for row in rows if row.waiting}
    fresh = set(connection.execute(OWNERS_OF_FRESH).scalars())
    begun = {row.owner: row.begun for row in connection.execute(sa.select(turns))}
    return [ProjectShare(owner, running.get(owner, 0), begun.get(owner, 0.0)) for owner in waiting | fresh]


def _first_fresh_query(most: int) -> sa.Select[Any]:
    """Ask for the first job of a project that nobody begins, and how many as urgent ones are begun or being begun."""
    owner = sa.bindparam("owner", type_=jobs.c.owner.type)
    earliest, latest = (sa.bindparam(name, type_=jobs.c.updated.type) for name in ("earliest", "latest"))
    changed = sa.func.coalesce(jobs.c.updated, jobs.c.created)
    begins = sa.and_(changed > jobs.c.created, changed.between(earliest, latest))
    columns = (jobs.c.urgency, jobs.c.created, jobs.c.id, begins.label("begins"))
    # each in the order of the index; when as many as may run are being begun, no more are
    heads = [
        sa.select(*columns).where(which, jobs.c.owner == owner).order_by(*columns[:3]).limit(most + 1).subquery()
        for which in UNPLANNED
    ]
    head = sa.union_all(*map(sa.select, heads)).cte()
    free = sa.select(head).where(sa.not_(head.c.begins)).order_by(head.c.urgency, head.c.created, head.c.id)
    first = free.limit(1).cte()
    begun = sa.select(sa.func.count()).select_from(jobs).where(OURS, jobs.c.owner == owner)
    begun = begun.where(jobs.c.urgency <= first.c.urgency).correlate(first)
    others = sa.select(sa.func.count()).select_from(head).where(head.c.begins, head.c.urgency <= first.c.urgency)
    number = begun.scalar_subquery() + others.correlate(first).scalar_subquery()
    return sa.select(first, number.label("number"))


def _first_step(connection: sa.Connection, owner: str) -> sa.RowMapping | None:
    """Find the waiting step of a project that comes first; in the order of `service.use_cases.jobs.turns`."""
    since = present(connection) - HELD_BACK_S
    held_back = sa.case((sa.and_(job_steps.c.deaths > 0.0, job_steps.c.waiting_since > since), 1), else_=0)
    query = (
        sa.select(job_steps, jobs.c.urgency, jobs.c.created, held_back.label("held_back"))
        .select_from(STEPS_OF_JOBS)
        .where(job_steps.c.state == WAITING, OURS, jobs.c.owner == owner)
        .order_by(jobs.c.urgency, held_back, job_steps.c.stage.desc(), jobs.c.created, jobs.c.id, job_steps.c.position)
        .limit(1)
    )
    return connection.execute(query).mappings().one_or_none()


def _place_in_line(step: sa.RowMapping) -> WaitingPlace:
    held_back = bool(step["held_back"])
    return WaitingPlace(step["urgency"], step["stage"], step["created"], step["job_id"], step["position"], held_back)


def _claim(connection: sa.Connection, executor_id: str, step: sa.RowMapping, now: datetime) -> ClaimedStep | None:
    """Assign a step to a worker; None when it was over just now."""
    begun = begin_step(connection, StepPlace(step["job_id"], step["stage"], step["position"]), executor_id, now)
    if begun is None:
        return None
    job, claimed = begun
    values = {"begun": present(connection)}
    if not connection.execute(sa.update(turns).where(turns.c.owner == job.owner).values(values)).rowcount:
        connection.execute(sa.insert(turns).values(owner=job.owner, **values))
    # the slot might have gone to another one whose step has just ended
    tell_waiting(connection, jobs.c.id != job.id, now)
    return claimed
