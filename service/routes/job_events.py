"""Follow a job by Server-Sent Events instead of asking again and again."""

import time
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import Header, Request, Response, status
from fastapi.responses import StreamingResponse
from fastapi.sse import format_sse_event

from service.dependencies import AdaptersDependency, BaseUrl, BaseUrlDependency
from service.ports import Job, JobStore
from service.routes.documents import status_info
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.readable_router import ReadableRouter
from service.use_cases.jobs.find_job import find_job
from service.use_cases.jobs.watch_job import state_of, watched

router = ReadableRouter(tags=["jobs"], responses=PROBLEM_RESPONSES)

PULSE_S = 15.0
"""Proxies close connections that are silent for longer."""
RETRY_MS = 1000
EVENTS = "text/event-stream"
UNBUFFERED = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
LastEventId = Annotated[
    str | None, Header(alias="Last-Event-ID", description="Last event that was received; what came before is left out.")
]


@router.get(
    "/jobs/{job_id}/events",
    summary="Events of a job (Server-Sent Events)",
    response_class=StreamingResponse,
    responses={
        status.HTTP_200_OK: {
            "description": "Each event holds the job's status document: `status` when the status has changed, "
            "`progress` when progress or step have. The stream ends after the final status.",
            "content": {EVENTS: {"schema": {}}},
        },
        status.HTTP_204_NO_CONTENT: {"description": "The job has ended and the client knows it: nothing will come."},
    },
)
def follow_job(
    request: Request,
    job_id: str,
    adapters: AdaptersDependency,
    url: BaseUrlDependency,
    last_event_id: LastEventId = None,
) -> Response:
    """Tell at once, and then whenever it changes, where a job stands; end with its final status."""
    job = find_job(job_id, adapters.jobs)
    if job.status.finished and last_event_id == state_of(job):
        return Response(status_code=status.HTTP_204_NO_CONTENT)
    if request.method == "HEAD":
        return Response(media_type=EVENTS, headers=UNBUFFERED)
    return StreamingResponse(_events(job, last_event_id, adapters.jobs, url), media_type=EVENTS, headers=UNBUFFERED)


async def _events(job: Job, known: str | None, jobs: JobStore, url: BaseUrl) -> AsyncIterator[bytes]:
    told, spoken = None, time.monotonic()
    async for changed in watched(job.id, known, jobs):
        if changed is not None:
            kind = "progress" if changed.status is told else "status"
            told, spoken = changed.status, time.monotonic()
            document = status_info(changed, url).model_dump_json(by_alias=True, exclude_none=True)
            yield format_sse_event(data_str=document, event=kind, id=state_of(changed), retry=RETRY_MS)
        elif time.monotonic() - spoken > PULSE_S:
            spoken = time.monotonic()
            yield format_sse_event(data_str=None, comment="still there")
