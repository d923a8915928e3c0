"""The one place where jobs become documents of OGC API - Processes 1.0."""

from collections.abc import Callable

from schemas.resources.jobs import StatusInfo
from schemas.values.links import Link
from service.ports import Job, JobState, JobStatus

RESULTS = "http://www.opengis.net/def/rel/ogc/1.0/results"


def status_info(job: Job | JobState, url: Callable[[str], str]) -> StatusInfo:
    """Describe where a job stands.

    Parameters
    ----------
    job
        The job.
    url
        Gives the full address of a path of this service.
    """
    here = url(f"/jobs/{job.id}")
    links = [Link(href=here, rel="self", title="This job")]
    if job.status is not JobStatus.ACCEPTED:
        links.append(Link(href=f"{here}/log", rel="related", type="text/plain", title="Log of the job"))
    if job.status in {JobStatus.SUCCESSFUL, JobStatus.FAILED}:
        links.append(Link(href=f"{here}/results", rel=RESULTS, title="Result of the job"))
    if job.status is JobStatus.SUCCESSFUL:
        links.append(Link(href=f"{here}/artifacts", rel="related", title="Downloads of the job"))
    if not job.status.finished:
        links.append(Link(href=here, rel="dismiss", title="DELETE to dismiss the job"))
        links.append(Link(href=here, rel="monitor", title="GET again for the job's status"))
        links.append(Link(href=f"{here}/events", rel="related", type="text/event-stream", title="Events of the job"))
    return StatusInfo(
        process_id=job.process_id,
        job_id=job.id,
        status=job.status.value,
        message=job.message,
        progress=job.progress,
        attempts=job.attempts,
        created=job.created,
        started=job.started,
        finished=job.finished,
        updated=job.updated,
        links=links,
    )
