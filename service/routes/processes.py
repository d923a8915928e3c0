"""Processes: list, description, execution."""

import asyncio
from datetime import UTC, datetime
from typing import Any

from fastapi import Request, Response
from fastapi.responses import JSONResponse

from schemas.resources.jobs import StatusInfo
from schemas.resources.processes import ProcessDescription, ProcessList, ProcessSummary
from schemas.values.links import Link
from service.dependencies import (
    AdaptersDependency,
    BaseUrl,
    BaseUrlDependency,
    BelongingsDependency,
    CallbacksDependency,
    OriginDependency,
    SettingsDependency,
    SourcesDependency,
)
from service.ports import Job, Process, Stored
from service.processes import PROCESSES, offered_process
from service.routes.described_processes import REFERENCE_TO_RESULTS
from service.routes.documents import page_links, status_info
from service.routes.multipart_related import NO_OUTPUT, OUTPUTS, raw_outputs
from service.routes.paging import LimitParameter, OffsetParameter, page_size
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.readable_router import ReadableRouter
from service.routes.request_bodies import json_body
from service.use_cases.callbacks.check_subscriber import checked_subscription
from service.use_cases.jobs.describe_processes import (
    input_descriptions,
    output_descriptions,
)
from service.use_cases.jobs.read_request import RequestDesk
from service.use_cases.jobs.submit_job import answer_at_once, submit_job

STATUS_INFO = {"$ref": "#/components/schemas/StatusInfo"}
EXECUTE = "http://www.opengis.net/def/rel/ogc/1.0/execute"

router = ReadableRouter(tags=["processes"], responses=PROBLEM_RESPONSES)


def _callback(uri: str, what: str, schema: dict[str, Any]) -> dict[str, Any]:
    """Describe what the service posts to an address of the subscriber."""
    answers = {"2XX": {"description": "Heard; after any other answer it is posted again, later and later."}}
    body = {"description": what, "required": True, "content": {"application/json": {"schema": schema}}}
    operation = {"summary": what, "requestBody": body, "responses": answers}
    return {f"{{$request.body#/subscriber/{uri}}}": {"post": operation}}


CALLBACKS = {
    "jobSuccess": _callback("successUri", "Result document of the job", {"type": "object"}),
    "jobInProgress": _callback("inProgressUri", "Status of the running job", STATUS_INFO),
    "jobFailed": _callback("failedUri", "Status of the job that failed or was dismissed", STATUS_INFO),
}


@router.get("/processes", summary="List processes")
def list_processes(url: BaseUrlDependency, limit: LimitParameter = 100, offset: OffsetParameter = 0) -> ProcessList:
    """List what this service can do."""
    offered, limit = PROCESSES, page_size(limit)
    return ProcessList(
        processes=[_summary(process, url) for process in offered[offset : offset + limit]],
        links=page_links(url, "/processes", {}, limit, offset, len(offered)),
    )


@router.get("/processes/{process_id}", summary="Describe a process")
def get_process(process_id: str, url: BaseUrlDependency) -> ProcessDescription:
    """Describe a process with the JSON Schemas of its inputs and outputs."""
    process = offered_process(process_id)
    return ProcessDescription(
        **dict(_summary(process, url)),
        inputs=input_descriptions(process),
        outputs=output_descriptions(process),
    )


@router.post(
    "/processes/{process_id}/execution",
    status_code=201,
    summary="Run a process",
    response_model=StatusInfo,
    responses={
        200: {
            "description": "The outputs of a process that answers at once.",
            "content": {**OUTPUTS, "application/json": {"schema": REFERENCE_TO_RESULTS}},
        },
        204: {"description": NO_OUTPUT},
    },
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {"application/json": {"schema": {"$ref": "#/components/schemas/Execute"}}},
        },
        "callbacks": CALLBACKS,
    },
)
async def execute(
    process_id: str,
    request: Request,
    adapters: AdaptersDependency,
    settings: SettingsDependency,
    belongings: BelongingsDependency,
    sources: SourcesDependency,
    callbacks: CallbacksDependency,
    origin: OriginDependency,
    url: BaseUrlDependency,
) -> Response:
    """Run a process in the background: 201 with the job. `echo` answers at once (200) unless asked otherwise."""
    process = offered_process(process_id)
    asynchronous = _prefers_async(request)
    stored = Stored(adapters.files, adapters.jobs, settings)
    desk = RequestDesk(stored, sources, belongings.owner, origin.make_id, adapters.requests)
    async with json_body(request) as (body, size):
        now = datetime.now(UTC)
        execution = await desk.execution(process, body, size, at_once=not asynchronous)
    subscription = None
    if execution.subscriber is not None:
        subscription = await checked_subscription(execution.subscriber, callbacks, url.url, settings)
    outputs = None if asynchronous else await answer_at_once(execution)
    if outputs is not None:
        return await asyncio.to_thread(raw_outputs if execution.raw else JSONResponse, outputs)
    job = await asyncio.to_thread(submit_job, execution, belongings, settings, now, subscription, origin)
    return created_job(job, url, applied="respond-async" if asynchronous else None)


def created_job(job: Job, url: BaseUrl, applied: str | None = None) -> Response:
    """Answer that a job was made, and where it is."""
    headers = {"Location": url(f"/jobs/{job.id}")}
    if applied:
        headers["Preference-Applied"] = applied
    document: dict[str, Any] = status_info(job, url).model_dump(mode="json", by_alias=True, exclude_none=True)
    return JSONResponse(document, status_code=201, headers=headers)


def _summary(process: Process[Any], url: BaseUrl) -> ProcessSummary:
    here = url(f"/processes/{process.id}")
    return ProcessSummary(
        id=process.id,
        title=process.title,
        description=process.description,
        version=process.version,
        job_control_options=list(process.job_control),
        output_transmission=["value", "reference"] if process.file_outputs else ["value"],
        links=[
            Link(href=here, rel="self", title="Description of the process"),
            Link(href=f"{here}/execution", rel=EXECUTE, title="POST to run it"),
        ],
    )


def _prefers_async(request: Request) -> bool:
    preferences = ",".join(request.headers.getlist("prefer")).lower().split(",")
    return any(preference.partition(";")[0].strip() == "respond-async" for preference in preferences)
