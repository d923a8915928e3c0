"""Stop a job, or remove a finished one."""

from dataclasses import replace
from datetime import datetime

from service.errors import NoSuchJobError
from service.ports import BlobStore, Job, JobStatus, JobStore
from service.use_cases.jobs.find_job import find_job


def dismiss_job(job_id: str, jobs: JobStore, blobs: BlobStore, now: datetime) -> Job:
    """Dismiss a job, of which its worker takes notice within two seconds; remove a finished one with all it stored.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    """
    job = find_job(job_id, jobs)
    if job.status.finished:
        jobs.delete(job_id)
        blobs.delete_prefix(f"jobs/{job_id}/")
        return replace(job, status=JobStatus.DISMISSED, message="removed with its result and downloads")
    dismissed = jobs.dismiss(job_id, now)
    if dismissed is None:
        raise NoSuchJobError(job_id)
    return dismissed
