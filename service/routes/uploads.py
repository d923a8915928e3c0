"""Resumable uploads by the protocol tus 1.0.0; the last byte makes a file of the upload, under the same id."""

from collections.abc import Callable, Coroutine
from dataclasses import replace
from datetime import UTC, datetime
from email.utils import format_datetime
from typing import Annotated, Any

import structlog
from fastapi import Depends, Request, Response
from fastapi.routing import APIRoute
from starlette.background import BackgroundTask

from schemas.resources.uploads import UploadDocument
from schemas.values.links import Link
from schemas.values.problem import ProblemDocument
from service.dependencies import (
    AdaptersDependency,
    BaseUrl,
    BaseUrlDependency,
    BelongingsDependency,
    IdentifiersDependency,
    SettingsDependency,
)
from service.errors import InvalidRequestError, ServiceError, to_problem
from service.ports import UploadState
from service.routes.files import file_intake
from service.routes.problems import PROBLEM_RESPONSES, error_response
from service.routes.readable_router import ReadableRouter
from service.routes.request_bodies import declared_length
from service.routes.tus_headers import (
    EXTENSIONS,
    PART_TYPE,
    VERSION,
    carries_part,
    require_part,
    require_version,
    upload_checksum,
    upload_filename,
    upload_length,
    upload_offset,
)
from service.use_cases.uploads.receive_uploads import CHECKSUMS, UploadDesk, UploadPart

FILE_HEADER = "Tieline-File"
PART_BODY = {
    "requestBody": {"content": {PART_TYPE: {"schema": {"type": "string", "contentMediaType": PART_TYPE}}}},
}
log = structlog.get_logger()


class TusRoute(APIRoute):
    """Check the version of the protocol, and name it in every answer, also when a request is refused."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Wrap the handler."""
        handle = super().get_route_handler()

        async def handle_tus(request: Request) -> Response:
            try:
                if request.method not in {"OPTIONS", "GET"}:
                    require_version(request)
                response = await handle(request)
            except ServiceError as error:
                response = error_response(error, request)
            response.headers["Tus-Resumable"] = VERSION
            response.headers["Tus-Version"] = VERSION
            response.headers["Cache-Control"] = "no-store"
            return response

        return handle_tus


router = ReadableRouter(tags=["uploads"], responses=PROBLEM_RESPONSES, route_class=TusRoute)


async def _desk(
    belongings: BelongingsDependency, adapters: AdaptersDependency, settings: SettingsDependency
) -> UploadDesk:
    return UploadDesk(belongings.uploads, file_intake(belongings, adapters, settings))


DeskDependency = Annotated[UploadDesk, Depends(_desk)]


async def _beginning_desk(desk: DeskDependency, make_id: IdentifiersDependency) -> UploadDesk:
    return replace(desk, intake=replace(desk.intake, make_id=make_id))


BeginningDeskDependency = Annotated[UploadDesk, Depends(_beginning_desk)]


@router.options("/uploads", status_code=204, summary="What of tus is spoken here")
async def tus_options(settings: SettingsDependency) -> Response:
    """Tell version, extensions, checksums and the largest upload."""
    headers = {
        "Tus-Extension": ",".join(EXTENSIONS),
        "Tus-Checksum-Algorithm": ",".join(CHECKSUMS),
        "Tus-Max-Size": str(settings.max_file_bytes),
    }
    return Response(status_code=204, headers=headers)


@router.post(
    "/uploads",
    status_code=201,
    summary="Begin a resumable upload (tus)",
    response_class=Response,
    openapi_extra=PART_BODY,
)
async def begin_upload(request: Request, desk: BeginningDeskDependency, url: BaseUrlDependency) -> Response:
    """Begin an upload of `Upload-Length` bytes; `Upload-Metadata` must hold its `filename`. A body is its first part.

    Of a text table the metadata may also hold `columns`, what its columns are, such as `row,col,x,y,z,i`.

    `Location` is where to continue. The file gets the same id as the upload; the answer to the last part, `HEAD` and
    `GET` name it in the header `Tieline-File`.
    """
    now = datetime.now(UTC)
    length = upload_length(request)
    filename, metadata = upload_filename(request)
    checksum = upload_checksum(request)
    state = await desk.begin(filename, length, metadata, now)
    if carries_part(request):
        part = UploadPart(0, request.stream(), declared_length(request), checksum)
        try:
            state = await desk.append(state.upload.id, part, now)
        except BaseException:  # its address was never told, so nobody could continue it
            await desk.terminate(state.upload.id)
            raise
    headers = {**_headers(state, desk, url), "Location": url(f"/uploads/{state.upload.id}")}
    headers.pop("Content-Location", None)
    return Response(status_code=201, headers=headers)


@router.head("/uploads/{upload_id}", summary="Where to continue (tus)", response_class=Response)
async def look_at_upload(upload_id: str, desk: DeskDependency, url: BaseUrlDependency) -> Response:
    """Tell `Upload-Offset`; a request for the same upload that has stalled is ended, a busy one means 423."""
    state = await desk.look(upload_id, datetime.now(UTC))
    headers = {**_headers(state, desk, url), "Upload-Length": str(state.upload.length)}
    if state.upload.metadata:
        headers["Upload-Metadata"] = state.upload.metadata
    return Response(status_code=200, headers=headers, background=_finishing(state, desk))


@router.patch("/uploads/{upload_id}", status_code=204, summary="Continue (tus)", openapi_extra=PART_BODY)
async def continue_upload(request: Request, upload_id: str, desk: DeskDependency, url: BaseUrlDependency) -> Response:
    """Append the body at `Upload-Offset`. The answer to the last part names the file: `Tieline-File`."""
    require_part(request)
    part = UploadPart(upload_offset(request), request.stream(), declared_length(request), upload_checksum(request))
    state = await desk.append(upload_id, part, datetime.now(UTC))
    return Response(status_code=204, headers=_headers(state, desk, url))


@router.get("/uploads/{upload_id}", summary="How far an upload is", response_model=UploadDocument)
async def describe_upload(upload_id: str, desk: DeskDependency, url: BaseUrlDependency) -> Response:
    """Describe an upload as JSON, with the file that it has become or why it was refused."""
    state = await desk.describe(upload_id, datetime.now(UTC))
    return Response(
        _document(state, desk, url).model_dump_json(by_alias=True),
        media_type="application/json",
        headers=_file_headers(state, url),
        background=_finishing(state, desk),
    )


@router.delete("/uploads/{upload_id}", status_code=204, summary="End an upload (tus)")
async def terminate_upload(upload_id: str, desk: DeskDependency) -> Response:
    """Remove an upload with its bytes; a file that it has become stays."""
    await desk.terminate(upload_id)
    return Response(status_code=204)


@router.post("/uploads/{upload_id}", include_in_schema=False)
async def overridden(request: Request, upload_id: str, desk: DeskDependency, url: BaseUrlDependency) -> Response:
    """Take the method from `X-HTTP-Method-Override`, for clients that cannot send others than GET and POST."""
    method = request.headers.get("x-http-method-override", "").upper()
    if method == "PATCH":
        return await continue_upload(request, upload_id, desk, url)
    if method == "HEAD":
        return await look_at_upload(upload_id, desk, url)
    if method == "DELETE":
        return await terminate_upload(upload_id, desk)
    raise InvalidRequestError("an upload takes HEAD, PATCH, DELETE, or POST with one of them in X-HTTP-Method-Override")


def _headers(state: UploadState, desk: UploadDesk, url: BaseUrl) -> dict[str, str]:
    return {
        "Upload-Offset": str(state.offset),
        "Upload-Expires": format_datetime(desk.expires(state).astimezone(UTC), usegmt=True),
        **_file_headers(state, url),
    }


def _file_headers(state: UploadState, url: BaseUrl) -> dict[str, str]:
    if not state.upload.finished:
        return {}
    return {FILE_HEADER: state.upload.id, "Content-Location": url(f"/files/{state.upload.id}")}


def _finishing(state: UploadState, desk: UploadDesk) -> BackgroundTask | None:
    """Make a file of a complete upload whose process died before it could."""
    if not state.complete or state.upload.finished or state.upload.problem is not None:
        return None

    async def finish() -> None:
        try:
            await desk.finish(state.upload.id, datetime.now(UTC))
        except ServiceError as error:  # the upload tells its problem to whoever asks
            log.info("an upload was refused", upload=state.upload.id, problem=to_problem(error))

    return BackgroundTask(finish)


def _document(state: UploadState, desk: UploadDesk, url: BaseUrl) -> UploadDocument:
    upload = state.upload
    status = "receiving"
    if upload.finished:
        status = "finished"
    elif upload.problem is not None:
        status = "refused"
    elif state.complete:
        status = "finishing"
    links = [Link(href=url(f"/uploads/{upload.id}"), rel="self", title="This upload")]
    if upload.finished:
        links.append(Link(href=url(f"/files/{upload.id}"), rel="related", title="The file"))
    return UploadDocument(
        id=upload.id,
        name=upload.filename,
        length=upload.length,
        offset=state.offset,
        status=status,
        file=upload.id if upload.finished else None,
        problem=None if upload.problem is None else ProblemDocument.model_validate(upload.problem),
        created=upload.created,
        expires=desk.expires(state),
        links=links,
    )
