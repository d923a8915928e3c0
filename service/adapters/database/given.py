"""Steps that Procrastinate gives to workers, on PostgreSQL: offered, withdrawn and taken back in our transactions.

Each step that waits or is computed has one job of the library, whose queueing lock names it; a job of which no step is
known yet has one that lets it be led on. What the library has no word for is said in priorities: -(urgency times 2^27,
plus virtual time), by start-time fair queueing. A job begins where its project's latest one ends, but not before what
waits, and each of its steps comes after the weight of those before it: so projects are served in turn, whatever one of
them sends, and within a project later steps of an older job come before the first of a younger one.

Transactions lock the row of a job, then those of its steps, then those of the library.
"""

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa

from service.adapters.database.tables import jobs, lock_name
from service.ports import JobStatus, StepPlace

TIMES = 1 << 27
"""Virtual times of each urgency: the priority is a number of 32 bits."""
HELD_BACK = 32
"""So far back in virtual time stands a step that was interrupted: it may be the cause."""
STEPS, ALONE = "steps", "alone"
"""Queues: steps, and those that may take their worker down, so that nothing else is computed there meanwhile."""
DEAD_AFTER_S = 6.0
UNFINISHED_JOB = jobs.c.status.in_([status.value for status in JobStatus if not status.finished])
NOT_OFFERED = "NOT EXISTS (SELECT 1 FROM procrastinate_jobs p WHERE p.status IN ('todo', 'doing') AND p.queueing_lock ="
KEY = "s.job_id || '/' || s.stage || '/' || s.position"


def gives(connection: sa.Connection | sa.Engine) -> bool:
    """Check whether steps are given to workers here, and not asked for."""
    return connection.get_execution_options().get("most_given_jobs") is not None


def offer_job(connection: sa.Connection, job_id: str) -> None:
    """Let a worker begin a job as soon as it is its turn, unless enough jobs of its project are under way."""
    job = connection.execute(sa.select(jobs).where(jobs.c.id == job_id)).one()
    ours = sa.and_(UNFINISHED_JOB, jobs.c.owner == job.owner, jobs.c.turn.is_not(None))
    as_urgent = sa.select(sa.func.count()).select_from(jobs).where(ours, jobs.c.urgency <= job.urgency)
    most = connection.get_execution_options()["most_given_jobs"]
    if job.planned == 0 and connection.execute(as_urgent).scalar_one() >= most:
        return
    end = sa.func.max(jobs.c.turn + sa.func.ceil(sa.func.greatest(jobs.c.total_weight, 1.0)))
    latest = connection.execute(sa.select(end).where(ours, jobs.c.urgency == job.urgency)).scalar() or 0
    turn = min(max(_present(connection, job.urgency) - 1, int(latest), 0), TIMES - 1)
    connection.execute(sa.update(jobs).where(jobs.c.id == job_id).values(turn=turn))
    _defer_lead(connection, [job_id])


def offer_next_job(connection: sa.Connection, owner: str) -> None:
    """Offer the next job of a project, one of which has ended."""
    lock_name(connection, f"jobs of {owner}")
    waiting = sa.select(jobs.c.id).where(UNFINISHED_JOB, jobs.c.owner == owner, jobs.c.turn.is_(None))
    # one that is dismissed just now waits for the same lock
    first = waiting.order_by(jobs.c.urgency, jobs.c.created, jobs.c.id).limit(1).with_for_update(skip_locked=True)
    found = connection.execute(first).scalar()
    if found is not None:
        offer_job(connection, found)


def offer_steps(connection: sa.Connection, job_id: str, *, missing: bool = False) -> None:
    """Offer the waiting steps of a job.

    Parameters
    ----------
    connection
        The row of the job is locked.
    job_id
        The job; it has its turn.
    missing
        Some are offered already.
    """
    others = f"AND {NOT_OFFERED} s.key)"
    connection.execute(
        sa.text(f"""
            SELECT procrastinate_defer_jobs_v1(array_agg(ROW(
                CASE WHEN s.deaths >= 1 THEN '{ALONE}' ELSE '{STEPS}' END, 'compute',
                -(s.urgency * {TIMES} + LEAST({TIMES - 1}, s.time))::integer, NULL, s.key,
                jsonb_build_object('job', s.job_id, 'stage', s.stage, 'position', s.position), NULL
            )::procrastinate_job_to_defer_v1 ORDER BY s.stage, s.position))
            FROM (
                SELECT s.*, {KEY} AS key, j.urgency, j.turn + floor(
                    sum(s.weight) OVER (ORDER BY s.stage, s.position) - s.weight
                    + CASE WHEN s.deaths > 0 THEN {HELD_BACK} ELSE 0 END
                )::bigint AS time
                FROM job_steps s JOIN jobs j ON j.id = s.job_id WHERE s.job_id = :job
            ) s WHERE s.state = 'waiting' {others if missing else ""}
        """),
        {"job": job_id},
    )


def withdraw(connection: sa.Connection, job_id: str) -> None:
    """Take the waiting steps of a job off the queue, and tell workers to give up those that they compute."""
    of_steps = f"SELECT {KEY} FROM job_steps s WHERE s.job_id = :job AND s.state = 'waiting'"
    keys = f"{of_steps} UNION ALL SELECT CAST(:job AS text)"
    waiting = f"SELECT p.id FROM procrastinate_jobs p WHERE p.status = 'todo' AND p.queueing_lock IN ({keys})"
    computed = "SELECT p.id FROM procrastinate_jobs p WHERE p.status = 'doing' AND p.args ->> 'job' = :job"
    connection.execute(
        sa.text(f"SELECT procrastinate_cancel_job_v1(f.id, true, true) FROM ({waiting} UNION ALL {computed}) f"),
        {"job": job_id},
    )


def take_back(connection: sa.Connection, place: StepPlace, *, alone: bool) -> None:
    """Let another worker have a step whose worker is gone; it stands back."""
    key = f"{place.job_id}/{place.stage}/{place.index}"
    query = "SELECT id, priority FROM procrastinate_jobs WHERE status = 'doing' AND queueing_lock = :key FOR UPDATE"
    row = connection.execute(sa.text(query), {"key": key}).one_or_none()
    if row is None:
        offer_steps(connection, place.job_id, missing=True)
    else:
        last = 1 - (1 + -row.priority // TIMES) * TIMES  # of its urgency
        _retry(connection, row.id, max(row.priority - HELD_BACK, last), ALONE if alone else STEPS)


def take_back_stalled(connection: sa.Connection) -> Sequence[str]:
    """Let others have what a worker of the library left that is gone, and was not begun; give its keys.

    A step that was begun is taken back with a count of its deaths, or goes on.
    """
    stalled = f"""
        SELECT p.id, p.queue_name, p.queueing_lock FROM procrastinate_jobs p
        LEFT JOIN procrastinate_workers w ON w.id = p.worker_id
        WHERE p.status = 'doing' AND (w.id IS NULL OR w.last_heartbeat < now() - interval '{DEAD_AFTER_S} seconds')
        AND NOT EXISTS (
            SELECT 1 FROM job_steps s
            WHERE s.job_id = p.args ->> 'job' AND s.state = 'running' AND {KEY} = p.queueing_lock
        ) FOR UPDATE OF p SKIP LOCKED
    """
    rows = connection.execute(sa.text(stalled)).all()
    for row in rows:
        _retry(connection, row.id, None, row.queue_name)
    return [row.queueing_lock for row in rows]


def offer_missing(connection: sa.Connection) -> Sequence[str]:
    """Offer what waits and is not on the queue, by a fault or because another queue had it; give its jobs."""
    without_turn = sa.select(jobs.c.id).where(UNFINISHED_JOB, jobs.c.turn.is_(None))
    order = (jobs.c.urgency, jobs.c.created, jobs.c.id)
    for job_id in connection.execute(without_turn.order_by(*order).with_for_update(skip_locked=True)).scalars().all():
        offer_job(connection, job_id)
    unfinished = "j.status IN ('accepted', 'running') AND j.turn IS NOT NULL"
    lead = f"SELECT j.id FROM jobs j WHERE {unfinished} AND j.planned = 0 AND {NOT_OFFERED} j.id)"
    steps = f"""SELECT DISTINCT s.job_id FROM job_steps s JOIN jobs j ON j.id = s.job_id
        WHERE s.state = 'waiting' AND j.planned > 0 AND {unfinished} AND {NOT_OFFERED} {KEY})"""
    led, left = (sorted(connection.execute(sa.text(query)).scalars()) for query in (lead, steps))
    _defer_lead(connection, led)
    for job_id in left:
        if connection.execute(
            sa.select(jobs.c.id).where(jobs.c.id == job_id).with_for_update(skip_locked=True)
        ).first():
            offer_steps(connection, job_id, missing=True)
    connection.execute(sa.text("DELETE FROM procrastinate_jobs WHERE status NOT IN ('todo', 'doing')"))
    return [*led, *left]


def _present(connection: sa.Connection, urgency: int) -> int:
    """Return the virtual time of an urgency: that of the next step, or else of the last that is computed, or else 0."""
    query = """SELECT COALESCE(
        (SELECT priority FROM procrastinate_jobs WHERE status = 'todo' AND priority BETWEEN :least AND :most
            ORDER BY priority DESC, id LIMIT 1),
        (SELECT min(priority) FROM procrastinate_jobs WHERE status = 'doing' AND priority BETWEEN :least AND :most))"""
    most = -urgency * TIMES
    found = connection.execute(sa.text(query), {"least": most - TIMES + 1, "most": most}).scalar()
    return 0 if found is None else most - int(found)


def _defer_lead(connection: sa.Connection, job_ids: Sequence[str]) -> None:
    if job_ids:
        connection.execute(
            sa.text(f"""
                SELECT procrastinate_defer_jobs_v1(array_agg(ROW(
                    '{STEPS}', 'lead', -(j.urgency * {TIMES} + j.turn)::integer, NULL, j.id,
                    jsonb_build_object('job', j.id), NULL
                )::procrastinate_job_to_defer_v1 ORDER BY j.created, j.id)) FROM jobs j WHERE j.id = ANY(:jobs)
            """),
            {"jobs": list(job_ids)},
        )


def _retry(connection: sa.Connection, library_id: int, priority: int | None, queue: str) -> None:
    values: dict[str, Any] = {"id": library_id, "priority": priority, "queue": queue}
    connection.execute(sa.text("SELECT procrastinate_retry_job_v2(:id, NULL, :priority, :queue, NULL)"), values)
    wake(connection, library_id, queue)


def wake(connection: sa.Connection, library_id: int, queue: str) -> None:
    """Tell workers of a step that is there again: the library tells of new ones only."""
    tell = sa.text(
        "SELECT pg_notify(:channel, json_build_object('type', 'job_inserted', 'job_id', CAST(:id AS bigint))::text)"
    )
    connection.execute(tell, {"channel": f"procrastinate_queue_v1#{queue}", "id": library_id})
