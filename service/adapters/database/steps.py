"""The steps of all jobs in the metadata database: which wait, which are computed by whom, and what came out.

A step is a row that waits, is computed by one worker, or is done with its output. Transactions change the row of a job
before those of its steps, so that no two wait for each other.
"""

import time
from collections.abc import Collection, Sequence
from datetime import datetime, timedelta
from typing import Any

import sqlalchemy as sa
import structlog

from service.adapters.database.executors import clock, present
from service.adapters.database.given import gives, offer_missing, offer_steps, take_back, take_back_stalled, withdraw
from service.adapters.database.jobs import UNFINISHED, change_job
from service.adapters.database.tables import executors, job_steps, jobs
from service.adapters.database.totals import add_to_totals, read_totals
from service.ports import (
    ClaimedStep,
    Job,
    JobStatus,
    Json,
    LeftBehind,
    LostStep,
    StepCall,
    StepFigures,
    StepPlace,
)

ORDER_OF_STEPS = 1
"""Changed only when the order of steps in a plan changes; jobs that were planned in another one are begun again."""
WAITING, RUNNING, DONE = "waiting", "running", "done"
QUIET = timedelta(seconds=2.0)
"""A job of which no step has run for so long waits: shorter pauses are those between two steps."""
SWEEP_S = 60.0
"""How often it is looked whether all that waits is on the queue."""
WAITS_MESSAGE = "waiting for a worker"
UNFINISHED_JOB = jobs.c.status.in_(UNFINISHED)
STEPS_OF_JOBS = job_steps.join(jobs, jobs.c.id == job_steps.c.job_id)
log = structlog.get_logger()
OURS = sa.and_(UNFINISHED_JOB, jobs.c.planned == ORDER_OF_STEPS)


class DatabaseSteps:
    """Keep steps and what comes of them.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine
        self._reading = engine.execution_options(reads_only=True)
        self._next_sweep = 0.0

    def plan_stage(self, job_id: str, stage: int, calls: Sequence[StepCall], total_weight: float) -> None:
        """Let the steps of a stage wait; doing so again changes nothing."""
        of_stage = sa.and_(job_steps.c.job_id == job_id, job_steps.c.stage == stage)
        values = {"total_weight": total_weight, "planned": ORDER_OF_STEPS}
        with self._engine.begin() as connection:
            unfinished = sa.and_(jobs.c.id == job_id, UNFINISHED_JOB)
            if not connection.execute(sa.update(jobs).where(unfinished).values(values)).rowcount:
                return
            if connection.execute(sa.select(job_steps.c.position).where(of_stage).limit(1)).first() is not None:
                return
            same = {"job_id": job_id, "stage": stage, "fraction": 0.0, "state": WAITING, "deaths": 0.0}
            same["waiting_since"] = clock(connection)
            rows = [
                {
                    **same,
                    "position": position,
                    "weight": call.weight,
                    "name": call.name,
                    "arguments": call.arguments,
                    "label": call.label,
                }
                for position, call in enumerate(calls)
            ]
            connection.execute(sa.insert(job_steps), rows)
            if gives(connection):
                offer_steps(connection, job_id)

    def outputs(self, job_id: str) -> Sequence[Sequence[Json]] | None:
        """Give the outputs of all stages; None while a step waits or is computed."""
        query = (
            sa.select(job_steps.c.stage, job_steps.c.state, job_steps.c.output)
            .where(job_steps.c.job_id == job_id)
            .order_by(job_steps.c.stage, job_steps.c.position)
        )
        unfinished = sa.exists().where(job_steps.c.job_id == job_id, job_steps.c.state != DONE)
        with self._reading.begin() as connection:
            # asked after every step: all outputs are read only once a stage is over
            if connection.execute(sa.select(unfinished)).scalar():
                return None
            rows = connection.execute(query).all()
        if any(row.state != DONE for row in rows):  # another worker has planned the next stage meanwhile
            return None
        # stages without any step have left no rows
        found: list[list[Json]] = [[] for _ in range(rows[-1].stage + 1)] if rows else []
        for row in rows:
            found[row.stage].append(row.output)
        return found

    # one step

    def begin_step(self, place: StepPlace, executor_id: str, now: datetime) -> ClaimedStep | None:
        """Let a worker have a step that it was given, and mark its job as running."""
        mine = sa.and_(job_steps.c.state == RUNNING, job_steps.c.executor == executor_id)
        wanted = sa.select(job_steps.c.label).where(_at(place), sa.or_(job_steps.c.state == WAITING, mine))
        with self._engine.begin() as connection:
            if not _lock(connection, place.job_id) or connection.execute(wanted).first() is None:
                return None
            begun = begin_step(connection, place, executor_id, now)
            return None if begun is None else begun[1]

    def report_step(self, place: StepPlace, executor_id: str, fraction: float, message: str, now: datetime) -> bool:
        """Record how far a step is; False when the job is gone or final, or another worker has the step."""
        with self._engine.begin() as connection:
            return _lock(connection, place.job_id) and _note(
                connection, place, executor_id, {"fraction": _grown(fraction)}, message, now
            )

    def finish_step(self, place: StepPlace, executor_id: str, output: Json, now: datetime) -> bool:
        """Record what came out; False as for `report_step`."""
        with self._engine.begin() as connection:
            if not _lock(connection, place.job_id):
                return False
            done = {"state": DONE, "output": output, "fraction": 1.0, "ended": clock(connection)}
            label = connection.execute(sa.select(job_steps.c.label).where(_at(place))).scalar() or ""
            if not _note(connection, place, executor_id, done, label, now):
                return False
            row = connection.execute(sa.select(job_steps).where(_at(place))).one()
            amounts = {"steps": 1.0, "step_seconds": row.ended - row.begun}
            amounts["step_wait_seconds"] = row.begun - row.waiting_since
            add_to_totals(connection, {(name, row.name): max(value, 0.0) for name, value in amounts.items()})
            return True

    def hand_back(self, executor_id: str, kept: Collection[StepPlace] = ()) -> None:
        """Put back what a worker has and does not compute, or will not."""
        with self._engine.begin() as connection:
            mine = sa.and_(
                job_steps.c.executor == executor_id,
                job_steps.c.state == RUNNING,
                *(sa.not_(_at(place)) for place in kept),
            )
            connection.execute(sa.update(job_steps).where(mine).values(_waiting(connection)))

    # what the dead leave

    def tidy(self, now: datetime, *, by_heart: bool = True) -> LeftBehind:
        """Find what workers that are gone have left, and mark jobs as waiting of which no step has run for a while."""
        gone = job_steps.c.executor.not_in(sa.select(executors.c.id))
        columns = (job_steps.c.job_id, job_steps.c.stage, job_steps.c.position, job_steps.c.executor)
        lost = sa.select(*columns).select_from(STEPS_OF_JOBS).where(job_steps.c.state == RUNNING, UNFINISHED_JOB, gone)
        unfinished = sa.exists().where(job_steps.c.job_id == jobs.c.id, job_steps.c.state != DONE)
        stalled = sa.select(jobs.c.id).where(OURS, sa.not_(unfinished))
        with self._engine.begin() as connection:
            tell_waiting(connection, jobs.c.updated < now - QUIET, now)
            steps = [LostStep(StepPlace(*row[:3]), row.executor) for row in connection.execute(lost)]
            if gives(connection):
                self._sweep(connection, by_heart=by_heart)
            return LeftBehind(steps, list(connection.execute(stalled).scalars()))

    def _sweep(self, connection: sa.Connection, *, by_heart: bool) -> None:
        """Mend what is on the queue: a fetched step that was not begun, and now and then what should be there."""
        if by_heart and (stalled := take_back_stalled(connection)):
            log.info("given again", steps=stalled)
        if time.monotonic() > self._next_sweep:
            if missing := offer_missing(connection):
                log.warning("was not on the queue", jobs=missing)
            self._next_sweep = time.monotonic() + SWEEP_S

    def put_back(self, lost: LostStep, death: float, now: datetime) -> float:
        """Let another worker compute a step whose worker is gone; give how many have died of it by now."""
        theirs = sa.and_(_at(lost.place), job_steps.c.executor == lost.executor_id, job_steps.c.state == RUNNING)
        with self._engine.begin() as connection:
            if not _lock(connection, lost.place.job_id):
                return 0.0
            values = {**_waiting(connection), "deaths": job_steps.c.deaths + death}
            if not connection.execute(sa.update(job_steps).where(theirs).values(values)).rowcount:
                return 0.0
            change_job(connection, lost.place.job_id, attempts=jobs.c.attempts + 1, updated=now)
            add_to_totals(connection, {("deaths", ""): 1.0})
            deaths = float(connection.execute(sa.select(job_steps.c.deaths).where(_at(lost.place))).scalar_one())
            if gives(connection):
                take_back(connection, lost.place, alone=deaths >= 1.0)
            return deaths

    def begin_stale_again(self) -> Sequence[str]:
        """Forget the steps of jobs that were planned in another order of steps, unless a living worker computes one."""
        lives = job_steps.c.executor.in_(sa.select(executors.c.id))
        computed = sa.exists().where(job_steps.c.job_id == jobs.c.id, job_steps.c.state == RUNNING, lives)
        stale = sa.and_(UNFINISHED_JOB, jobs.c.planned.not_in((0, ORDER_OF_STEPS)), sa.not_(computed))
        with self._engine.begin() as connection:
            found = list(connection.execute(sa.select(jobs.c.id).where(stale).with_for_update()).scalars())
            connection.execute(sa.update(jobs).where(jobs.c.id.in_(found)).values(planned=0))
            for job_id in found if gives(connection) else ():
                withdraw(connection, job_id)
            connection.execute(sa.update(jobs).where(jobs.c.id.in_(found)).values(turn=None))
            connection.execute(sa.delete(job_steps).where(job_steps.c.job_id.in_(found)))
        return found

    def figures(self) -> StepFigures:
        """Give what Prometheus is told."""
        counts = sa.select(job_steps.c.state, sa.func.count(), sa.func.min(job_steps.c.waiting_since))
        of_states = counts.where(job_steps.c.state.in_((WAITING, RUNNING))).group_by(job_steps.c.state)
        with self._reading.begin() as connection:
            found = {row[0]: row for row in connection.execute(of_states)}
            wait_s = clock(connection) - found[WAITING][2] if WAITING in found else 0.0
            numbers = {state: found[state][1] if state in found else 0 for state in (WAITING, RUNNING)}
            return StepFigures(numbers[WAITING], numbers[RUNNING], max(wait_s, 0.0), read_totals(connection))


def tell_waiting(connection: sa.Connection, which: sa.ColumnElement[bool], now: datetime) -> None:
    """Mark jobs as waiting of which steps wait and none is computed."""
    of_job = job_steps.c.job_id == jobs.c.id
    runs = sa.exists().where(of_job, job_steps.c.state == RUNNING)
    waits = sa.exists().where(of_job, job_steps.c.state == WAITING)
    idle = sa.and_(jobs.c.status == JobStatus.RUNNING.value, which, waits, sa.not_(runs))
    # in an order, so that no two transactions wait for each other
    found = list(connection.execute(sa.select(jobs.c.id).where(idle).order_by(jobs.c.id)).scalars())
    for job_id in found:
        values = {"status": JobStatus.ACCEPTED.value, "message": WAITS_MESSAGE, "updated": now}
        connection.execute(sa.update(jobs).where(jobs.c.id == job_id, idle).values(values))


def begin_step(
    connection: sa.Connection, place: StepPlace, executor_id: str, now: datetime
) -> tuple[Job, ClaimedStep] | None:
    """Assign a waiting step to a worker, and mark its job as running; None when it was over just now."""
    label = sa.select(job_steps.c.label).where(_at(place)).scalar_subquery()
    job = change_job(
        connection,
        place.job_id,
        status=JobStatus.RUNNING.value,
        attempts=sa.case((jobs.c.attempts < 1, 1), else_=jobs.c.attempts),
        started=sa.func.coalesce(jobs.c.started, sa.literal(now, jobs.c.started.type)),
        message=label,
        updated=now,
    )
    if job is None:
        return None
    # the answer to an earlier try may have been lost; who was taken for dead begins nothing
    mine = sa.and_(job_steps.c.state == RUNNING, job_steps.c.executor == executor_id)
    lives = sa.exists().where(executors.c.id == executor_id)
    waiting = sa.and_(_at(place), sa.or_(job_steps.c.state == WAITING, mine), lives)
    values = {"state": RUNNING, "executor": executor_id, "begun": present(connection)}
    step = connection.execute(sa.update(job_steps).where(waiting).values(values).returning(job_steps)).one_or_none()
    if step is None:
        return None
    return job, ClaimedStep(place, step.name, step.arguments, step.label, job.request_id, step.deaths)


def _note(
    connection: sa.Connection, place: StepPlace, executor_id: str, values: Json, message: str, now: datetime
) -> bool:
    """Change a step that a worker has, and the progress of its job; False when the worker has it no more."""
    mine = sa.and_(_at(place), job_steps.c.executor == executor_id, job_steps.c.state == RUNNING)
    if not connection.execute(sa.update(job_steps).where(mine).values(values)).rowcount:
        return False
    done = sa.func.coalesce(sa.func.sum(job_steps.c.weight * job_steps.c.fraction), 0.0)
    known = sa.func.coalesce(sa.func.sum(job_steps.c.weight), 0.0)
    sums = connection.execute(sa.select(done, known).where(job_steps.c.job_id == place.job_id)).one()
    total = connection.execute(sa.select(jobs.c.total_weight).where(jobs.c.id == place.job_id)).scalar() or 0.0
    # 100 is for the job that has succeeded
    progress = min(99, int(100 * float(sums[0]) / max(float(sums[1]), total, 1e-12)))
    grown = sa.case((jobs.c.progress < progress, progress), else_=jobs.c.progress)
    told: dict[str, Any] = {"progress": grown, "message": message, "updated": now}
    connection.execute(sa.update(jobs).where(jobs.c.id == place.job_id).values(told))
    return True


def _lock(connection: sa.Connection, job_id: str) -> bool:
    """Keep others from changing a job until the transaction ends; False when it is gone or final."""
    job = sa.select(jobs.c.id).where(jobs.c.id == job_id, UNFINISHED_JOB).with_for_update()
    return connection.execute(job).first() is not None


def _waiting(connection: sa.Connection) -> Json:
    return {"state": WAITING, "executor": None, "waiting_since": clock(connection)}


def _at(place: StepPlace) -> sa.ColumnElement[bool]:
    return sa.and_(
        job_steps.c.job_id == place.job_id, job_steps.c.stage == place.stage, job_steps.c.position == place.index
    )


def _grown(fraction: float) -> sa.ColumnElement[float]:
    """Let progress only grow."""
    return sa.case((job_steps.c.fraction < fraction, fraction), else_=job_steps.c.fraction)
