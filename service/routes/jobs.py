"""Jobs: list, status, result, downloads, dismissal."""

from collections.abc import Callable, Coroutine
from datetime import UTC, datetime
from typing import Any
from urllib.parse import quote

from fastapi import Request, Response
from fastapi.responses import JSONResponse, PlainTextResponse
from fastapi.routing import APIRoute

from schemas.resources.jobs import ArtifactList, JobList, StatusInfo
from schemas.results.registration_result import Artifact
from schemas.values.links import Link
from service.dependencies import AdaptersDependency, BaseUrlDependency, adapters_of, base_url_of
from service.routes.described_processes import REFERENCE_TO_RESULTS
from service.routes.documents import page_links, status_info
from service.routes.downloads import ANY, DOWNLOAD_RESPONSES, Download
from service.routes.job_query import JobQueryDependency
from service.routes.multipart_related import NO_OUTPUT, OUTPUTS, raw_outputs
from service.routes.problems import PROBLEM_RESPONSES, problem_response
from service.routes.readable_router import ReadableRouter
from service.use_cases.jobs.dismiss_job import dismiss_job
from service.use_cases.jobs.find_job import (
    find_artifact,
    find_artifacts,
    find_inputs,
    find_job,
    find_result,
    look_at_job,
    wanted_outputs,
)


class StatusRoute(APIRoute):
    """Answer without the framework's search for what a function needs: it takes longer than all the rest."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Give what answers."""

        async def handle_status(request: Request) -> Response:
            return await get_job(request.path_params["job_id"], adapters_of(request), base_url_of(request))

        return handle_status


router = ReadableRouter(tags=["jobs"], responses=PROBLEM_RESPONSES)
status_router = ReadableRouter(tags=["jobs"], responses=PROBLEM_RESPONSES, route_class=StatusRoute)
"""Asked more often than all others together, and so to be asked first whether a request is for it."""
RESULT_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The result document, or the outputs that were wanted.",
        "content": {**OUTPUTS, "application/json": {"schema": REFERENCE_TO_RESULTS}},
    },
    204: {"description": NO_OUTPUT},
    206: {"description": "The range of the document that was asked for.", "content": ANY},
    304: {"description": "It is what the client has already (`If-None-Match`)."},
}
MOST_LOG_LINES = 20_000
"""A job with more has its oldest left out."""


@status_router.get("/jobs/{job_id}", summary="Status of a job", response_model=StatusInfo)
async def get_job(job_id: str, adapters: AdaptersDependency, url: BaseUrlDependency) -> Response:
    """Tell where a job stands: status, progress in percent, what is being done."""
    document = status_info(await look_at_job(job_id, adapters.jobs), url)
    return Response(document.model_dump_json(by_alias=True, exclude_none=True), media_type="application/json")


@router.get("/jobs", summary="List jobs, newest first", response_model_exclude_none=True)
def list_jobs(adapters: AdaptersDependency, url: BaseUrlDependency, query: JobQueryDependency) -> JobList:
    """List the jobs of this service, newest first, page by page."""
    which = query.which
    found, total = ([], 0) if query.hopeless else adapters.jobs.find(which)
    return JobList(
        jobs=[status_info(job, url) for job in found],
        number_matched=total,
        number_returned=len(found),
        links=page_links(url, "/jobs", query.repeated, which.limit, which.offset, total),
    )


@router.delete("/jobs/{job_id}", summary="Dismiss or remove a job", response_model_exclude_none=True)
def delete_job(job_id: str, adapters: AdaptersDependency, url: BaseUrlDependency) -> StatusInfo:
    """Dismiss a waiting or running job; remove a finished one with its result and downloads."""
    job = dismiss_job(job_id, adapters.jobs, adapters.blobs, datetime.now(UTC))
    return status_info(job, url)


@router.get("/jobs/{job_id}/results", summary="Result of a job", responses=RESULT_RESPONSES)
def get_results(job_id: str, request: Request, adapters: AdaptersDependency) -> Response:
    """Give the result document, or those outputs that were wanted when the job was made, in the form that was wanted.

    A failed job answers with its problem and that problem's status.
    """
    result = find_result(job_id, adapters.jobs, adapters.blobs)
    if isinstance(result, dict):
        return problem_response(result, request)
    job = find_job(job_id, adapters.jobs)
    if job.wanted is None:
        made = job.finished or job.created
        return Download(result, identity=f"{job_id}-result", modified=made, media_type="application/json", inline=True)
    outputs = wanted_outputs(result, job.wanted)
    return raw_outputs(outputs) if job.wanted["raw"] else JSONResponse(outputs)


@router.get(
    "/jobs/{job_id}/log",
    summary="Log of a job",
    response_class=PlainTextResponse,
    responses={200: {"description": "Lines of time, level and text, the oldest first."}},
)
def get_log(job_id: str, adapters: AdaptersDependency) -> Response:
    """Give what happened to a job: its steps, how long they took, what failed."""
    find_job(job_id, adapters.jobs)
    lines = [
        f"{line.time.isoformat(timespec='milliseconds')} {line.level:7} {line.text}\n"
        for line in adapters.log.read(job_id, MOST_LOG_LINES)
    ]
    return PlainTextResponse("".join(lines), headers={"X-Content-Type-Options": "nosniff"})


@router.get("/jobs/{job_id}/inputs", summary="Inputs of a job", response_model=dict[str, Any])
def get_inputs(job_id: str, adapters: AdaptersDependency) -> Response:
    """Give what the job was asked for, defaults filled in, as it may be sent again with something changed."""
    return Response(find_inputs(job_id, adapters.jobs), media_type="application/json")


@router.get("/jobs/{job_id}/artifacts", summary="Downloads of a job")
def list_artifacts(job_id: str, adapters: AdaptersDependency, url: BaseUrlDependency) -> ArtifactList:
    """List the downloads of a job."""
    here = f"/jobs/{job_id}/artifacts"
    artifacts = [
        Artifact(
            name=found.name,
            type=found.media_type,
            bytes=found.bytes,
            href=url(f"{here}/{quote(found.name)}"),
        )
        for found in find_artifacts(job_id, adapters.jobs, adapters.blobs)
    ]
    return ArtifactList(artifacts=artifacts, links=[Link(href=url(here), rel="self", title="These downloads")])


@router.get("/jobs/{job_id}/artifacts/{name}", summary="One download of a job", responses=DOWNLOAD_RESPONSES)
def get_artifact(job_id: str, name: str, adapters: AdaptersDependency) -> Response:
    """Send a download, or the range of it that was asked for."""
    found = find_artifact(job_id, name, adapters.jobs, adapters.blobs)
    return Download(
        adapters.blobs.local_path(found.key),
        identity=f"{job_id}-{quote(name, safe='')}",
        modified=found.made,
        media_type=found.media_type,
        filename=found.name,
        inline=found.media_type in {"text/html", "application/json", "text/plain"},
    )
