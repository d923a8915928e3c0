"""Follow a job until it ends."""

import asyncio
from collections.abc import AsyncIterator

from service.errors import NoSuchJobError
from service.ports import Job, JobState, JobStore
from service.use_cases.jobs.find_job import look_at_job

LOOK_S = 0.3
"""How often a followed job is looked at."""


def state_of(job: Job | JobState) -> str:
    """Name the state a job is in; another name whenever anything about it has changed."""
    changed = job.updated or job.created
    return f"{changed.timestamp():.6f}-{job.status.value}"


async def watched(job_id: str, known: str | None, jobs: JobStore) -> AsyncIterator[JobState | None]:
    """Give a job whenever it has changed, and None at every look in between, until it has ended or is removed.

    Parameters
    ----------
    job_id
        The job.
    known
        Name of the state that the watcher knows already; None: it knows nothing.
    jobs
        Where jobs are kept.
    """
    while True:
        try:
            job = await look_at_job(job_id, jobs)
        except NoSuchJobError:
            return
        state = state_of(job)
        yield None if state == known else job
        if job.status.finished:
            return
        known = state
        await asyncio.sleep(LOOK_S)
