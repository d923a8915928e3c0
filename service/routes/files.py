"""Files: upload, list, metadata, content, removal."""

import asyncio
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Any

from fastapi import Request, Response
from fastapi.responses import JSONResponse

from schemas.resources.files import FileDocument, FileDocuments, FileList
from service.dependencies import (
    Adapters,
    AdaptersDependency,
    BaseUrlDependency,
    BelongingsDependency,
    IdentifiersDependency,
    SettingsDependency,
)
from service.errors import (
    FieldFault,
    FileTooLargeError,
    InvalidRequestError,
    StorageError,
    UnsupportedMediaTypeError,
)
from service.names.content_keys import content_key
from service.names.identifiers import MakeIdentifier, new_identifier
from service.routes.documents import file_document, page_links
from service.routes.downloads import DOWNLOAD_RESPONSES, Download
from service.routes.leaving_clients import marked, unless_client_leaves
from service.routes.paging import LimitParameter, OffsetParameter, page_size
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.readable_router import ReadableRouter
from service.routes.request_bodies import (
    FILE,
    FormReader,
    body_of,
    columns_of_form,
    content_length,
    declared_length,
    media_type,
    raw_filename,
    require_filename,
)
from service.settings import Settings
from service.use_cases.inputs.stated_columns import FIELD, HEADER, stated_columns
from service.use_cases.inputs.validate_request import pointer_to
from service.use_cases.limits.quotas import Belongings
from service.use_cases.uploads.store_files import FileIntake, Upload, delete_file, find_file

router = ReadableRouter(tags=["files"], responses=PROBLEM_RESPONSES)

COLUMNS = (
    "What the columns of text tables are, where neither names in the file nor the numbers tell, such as "
    "`row,col,x,y,z,i`: x, y, z, i(ntensity), r, g, b; any other name is passed over. A statement that the file "
    f"contradicts is refused. A raw body has it in the header `{HEADER}`, a resumable upload in its metadata."
)
UPLOAD_BODY = {
    "parameters": [
        {"name": HEADER, "in": "header", "required": False, "description": COLUMNS, "schema": {"type": "string"}}
    ],
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {"$ref": "#/components/schemas/FilesForm"},
            },
            "application/octet-stream": {"schema": FILE},
        },
    },
}

FILES_FORM: dict[str, Any] = {
    "title": "FilesForm",
    "description": "Files of one upload.",
    "type": "object",
    "required": ["file"],
    "properties": {
        "file": {"type": "array", "items": FILE, "description": "The files, one or more."},
        "columns": {"type": "string", "description": COLUMNS},
    },
}
"""Named, because generators of clients call a class after it."""


def file_intake(
    belongings: Belongings, adapters: Adapters, settings: Settings, make_id: MakeIdentifier = new_identifier
) -> FileIntake:
    """Give the place where uploads go."""
    return FileIntake(belongings, adapters.blobs, adapters.steps, settings, make_id)


@router.post(
    "/files",
    status_code=201,
    summary="Upload scans",
    response_model=FileDocument | FileDocuments,
    openapi_extra=UPLOAD_BODY,
)
async def upload_files(
    request: Request,
    adapters: AdaptersDependency,
    settings: SettingsDependency,
    belongings: BelongingsDependency,
    make_id: IdentifiersDependency,
    url: BaseUrlDependency,
) -> Response:
    """Store one file or several (all or none): multipart fields `file`, or a raw body with Content-Disposition.

    Of text tables whose columns neither names nor numbers tell, `columns` says what they are.
    """
    intake = file_intake(belongings, adapters, settings, make_id)
    body = _UploadBody(request, intake)
    read = asyncio.Event()
    work = intake.store(marked(body.uploads(), read), datetime.now(UTC), body.columns)
    stored = await unless_client_leaves(request, work, read)
    documents = [file_document(file, url) for file in stored]
    if len(documents) == 1:
        location = url(f"/files/{documents[0].id}")
        content = documents[0].model_dump(mode="json", by_alias=True)
    else:
        location = url("/files")
        content = FileDocuments(files=documents).model_dump(mode="json", by_alias=True)
    return JSONResponse(content, status_code=201, headers={"Location": location})


@router.get("/files", summary="List files, newest first")
def list_files(
    adapters: AdaptersDependency, url: BaseUrlDependency, limit: LimitParameter = 100, offset: OffsetParameter = 0
) -> FileList:
    """List the files of this service, newest first, page by page."""
    limit = page_size(limit)
    found, total = adapters.files.find(limit, offset)
    return FileList(
        files=[file_document(file, url) for file in found],
        number_matched=total,
        number_returned=len(found),
        links=page_links(url, "/files", {}, limit, offset, total),
    )


@router.get("/files/{file_id}", summary="Metadata of a file")
def get_file(file_id: str, adapters: AdaptersDependency, url: BaseUrlDependency) -> FileDocument:
    """Tell what a file is and which scans it holds."""
    return file_document(find_file(file_id, adapters.files), url)


@router.get("/files/{file_id}/content", summary="Content of a file", responses=DOWNLOAD_RESPONSES)
def get_content(file_id: str, adapters: AdaptersDependency) -> Response:
    """Send a file as it was uploaded, or the range of it that was asked for."""
    file = find_file(file_id, adapters.files)
    try:
        path = adapters.blobs.local_path(content_key(file.sha256))
    except FileNotFoundError:
        raise StorageError(f"the content of file '{file_id}' is missing from the storage") from None
    return Download(
        path,
        identity=file.sha256,
        modified=file.created,
        media_type="application/octet-stream",
        filename=file.name,
    )


@router.delete("/files/{file_id}", status_code=204, summary="Remove a file")
def remove_file(file_id: str, adapters: AdaptersDependency) -> None:
    """Remove a file, unless a job that has not finished reads it."""
    delete_file(file_id, adapters.files, adapters.jobs, adapters.blobs)


class _UploadBody:
    """Hand out the files as they arrive, and tell in the end what was said of their columns."""

    def __init__(self, request: Request, intake: FileIntake) -> None:
        self._request = request
        self._intake = intake
        self._columns = stated_columns(request.headers.get(HEADER, ""), HEADER)

    def columns(self) -> str:
        return self._columns

    async def uploads(self) -> AsyncIterator[Upload]:
        request, intake = self._request, self._intake
        length = declared_length(request) or 0
        await asyncio.to_thread(intake.require_room, length)
        await asyncio.to_thread(intake.require_quota, content_length(request))
        kind = media_type(request)
        if kind == "multipart/form-data":
            async for upload in self._of_form():
                yield upload
        elif kind.startswith("multipart/"):
            raise UnsupportedMediaTypeError(f"{kind} is not taken; send multipart/form-data or a raw body")
        else:
            filename = raw_filename(request)
            if length > intake.settings.max_file_bytes:
                raise FileTooLargeError(filename, length, intake.settings.max_file_bytes)
            yield Upload(filename, body_of(request), length)

    async def _of_form(self) -> AsyncIterator[Upload]:
        found = False
        async for part in FormReader(self._request).parts():
            if part.name == FIELD and not self._columns:
                self._columns = await columns_of_form(part)
                continue
            if part.name != "file":
                detail = f"unknown field; files are sent in fields called `file`, and once `{FIELD}`"
                raise InvalidRequestError(detail, [FieldFault(pointer_to(part.name), detail)])
            found = True
            yield Upload(require_filename(part.name, part.filename), part.chunks, part.at_most)
        if not found:
            detail = "the form holds no field `file`"
            raise InvalidRequestError(detail, [FieldFault("/file", detail)])
