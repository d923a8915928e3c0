"""Registration in one request."""

import asyncio
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Any

from fastapi import APIRouter, Request, Response

from schemas.jobs import StatusInfo
from service.dependencies import AdaptersDependency, BaseUrlDependency, OriginDependency, SettingsDependency
from service.errors import FieldFault, InvalidRequestError, UnsupportedMediaTypeError
from service.routes.files import file_intake
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.processes import created_job
from service.routes.request_bodies import (
    FormReader,
    content_length,
    declared_length,
    media_type,
    read_within,
    require_filename,
)
from service.use_cases.register_uploads import FormContents, register_uploads
from service.use_cases.store_files import FileIntake, Upload
from service.use_cases.validate_request import parse_json, pointer_to

MAX_OPTIONS_BYTES = 1_000_000

EXAMPLE = (
    '{"stations": [{"scan": {"file": "a.ptx"}, '
    '"photos": [{"file": "a.jpg", "camera": {…}, "scan_from_camera": [[…], …]}]}]}'
)
OPTIONS = (
    "Inputs of the process `register`, all optional. `stations` is needed for photos sent beside the scans; it gives "
    f"files by the names under which they are sent, for example `{EXAMPLE}`. A station without `scan` is that of the "
    "scan whose name it bears (S1, S2, … in the order of the form) or of the next scan; a photo without `file` is the "
    "next photo. A station without `photos` has those that its E57 file stores with camera and pose (up to 200); an "
    "empty list leaves them out. Scans not listed become stations of their own, after the listed ones; the first "
    "station gives the common frame."
)

router = APIRouter(tags=["registrations"], responses=PROBLEM_RESPONSES)


@router.post(
    "/registrations",
    status_code=201,
    summary="Upload scans and photos and register them",
    response_model=StatusInfo,
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                "multipart/form-data": {
                    "schema": {
                        "type": "object",
                        "required": ["scan"],
                        "properties": {
                            "scan": {
                                "type": "array",
                                "items": {"type": "string", "contentMediaType": "application/octet-stream"},
                                "description": "Scan files; every scan in them becomes a station: S1, S2, …",
                            },
                            "photo": {
                                "type": "array",
                                "items": {"type": "string", "contentMediaType": "application/octet-stream"},
                                "description": "Photos taken from the stations; `stations` of the options tell where.",
                            },
                            "options": {
                                "type": "string",
                                "contentMediaType": "application/json",
                                "description": OPTIONS,
                            },
                        },
                    }
                }
            },
        }
    },
)
async def register(
    request: Request,
    adapters: AdaptersDependency,
    settings: SettingsDependency,
    origin: OriginDependency,
    url: BaseUrlDependency,
) -> Response:
    """Store scans and photos (all or none) and start the process `register`."""
    if media_type(request) != "multipart/form-data":
        raise UnsupportedMediaTypeError(
            "send multipart/form-data with fields `scan` and, if wanted, `photo`, `options`"
        )
    intake = file_intake(adapters, settings, origin.make_id)
    form = _RegistrationForm(request, intake)
    job = await register_uploads(intake, adapters.jobs, form.files(), form.contents, datetime.now(UTC), origin)
    return created_job(job, url)


class _RegistrationForm:
    """Hand out the files as they arrive and keep the options, wherever in the form they stand."""

    def __init__(self, request: Request, intake: FileIntake) -> None:
        self._request = request
        self._intake = intake
        self._options: bytes | None = None
        self._are_photos: list[bool] = []

    async def files(self) -> AsyncIterator[Upload]:
        length = declared_length(self._request) or 0
        await asyncio.to_thread(self._intake.require_room, length)
        await asyncio.to_thread(self._intake.require_quota, content_length(self._request))
        async for part in FormReader(self._request).parts():
            if part.name in {"scan", "photo"}:
                self._are_photos.append(part.name == "photo")
                yield Upload(require_filename(part.name, part.filename), part.chunks, part.at_most)
            elif part.name == "options" and self._options is None:
                self._options = await read_within("the field `options`", part.chunks, MAX_OPTIONS_BYTES)
            else:
                raise _refused(part.name)

    def contents(self) -> FormContents:
        options: Any = {} if self._options is None else parse_json(self._options, "/options")
        return FormContents(options, self._are_photos)


def _refused(name: str) -> InvalidRequestError:
    detail = "unknown field; the form takes `scan` (several), `photo` (several) and `options`"
    if name == "options":
        detail = "the field `options` may stand in the form only once"
    return InvalidRequestError(detail, [FieldFault(pointer_to(name), detail)])
