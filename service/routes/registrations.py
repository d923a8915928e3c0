"""Registration in one request."""

import asyncio
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Any

from fastapi import APIRouter, Request, Response

from schemas.requests.subscriber import Subscriber
from schemas.resources.jobs import StatusInfo
from service.dependencies import (
    AdaptersDependency,
    BaseUrlDependency,
    BelongingsDependency,
    CallbacksDependency,
    OriginDependency,
    SettingsDependency,
)
from service.errors import FieldFault, InvalidRequestError, UnsupportedMediaTypeError
from service.ports import Subscription
from service.processes.register import REGISTER
from service.routes.files import COLUMNS, file_intake
from service.routes.leaving_clients import marked, unless_client_leaves
from service.routes.problems import PROBLEM_RESPONSES
from service.routes.processes import CALLBACKS, created_job
from service.routes.request_bodies import (
    FILE,
    FormReader,
    columns_of_form,
    content_length,
    declared_length,
    media_type,
    read_within,
    require_filename,
)
from service.use_cases.callbacks.check_subscriber import checked_subscription
from service.use_cases.inputs.stated_columns import FIELD, HEADER, stated_columns
from service.use_cases.inputs.validate_request import parse_json, pointer_to
from service.use_cases.jobs.register_uploads import FormContents, register_uploads
from service.use_cases.uploads.store_files import FileIntake, Upload

MAX_OPTIONS_BYTES = 1_000_000

EXAMPLE = (
    '{"stations": [{"scan": {"file": "a.ptx"}, '
    '"photos": [{"file": "a.jpg", "camera": {…}, "scan_from_camera": [[…], …]}]}]}'
)
OPTIONS = (
    "Inputs of the process `register`, all optional. `stations` is needed for photos sent beside the scans; it gives "
    f"files by the names under which they are sent, for example `{EXAMPLE}`. A station without `scan` is that of the "
    "scan whose name it bears (that of its file without the ending, with -1, -2, … where the file holds several scans; "
    "or its number in the form, S1, S2, …) or of the next scan; a photo without `file` is the next photo. A station "
    "without `photos` has those that its E57 file stores with camera and pose (up to 200); an "
    "empty list leaves them out. Scans not listed become stations of their own, after the listed ones; the first "
    "station gives the common frame. `unit` (mm, m, ft, us-ft) is that of all scans; the `scan` of a station may have "
    "a `unit` of its own. The options may also be a whole request for the execution of `register`: "
    '`{"inputs": …, "outputs": …, "subscriber": …}`.'
)
SUBSCRIBER = "Whom the job tells how it goes, as in a request for an execution: addresses, and a secret if wanted."
ONCE = ("options", "subscriber")

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
                        "title": "RegistrationForm",
                        "type": "object",
                        "required": ["scan"],
                        "properties": {
                            "scan": {
                                "type": "array",
                                "items": FILE,
                                "description": "Scan files; every scan in them is a station named after its file.",
                            },
                            "photo": {
                                "type": "array",
                                "items": FILE,
                                "description": "Photos taken from the stations; `stations` of the options tell where.",
                            },
                            "columns": {"type": "string", "description": COLUMNS},
                            "options": {
                                "type": "string",
                                "contentMediaType": "application/json",
                                "description": OPTIONS,
                            },
                            "subscriber": {
                                "type": "string",
                                "contentMediaType": "application/json",
                                "contentSchema": {"$ref": "#/components/schemas/Subscriber"},
                                "description": SUBSCRIBER,
                            },
                        },
                    }
                }
            },
        },
        "callbacks": CALLBACKS,
    },
)
async def register(
    request: Request,
    adapters: AdaptersDependency,
    settings: SettingsDependency,
    belongings: BelongingsDependency,
    callbacks: CallbacksDependency,
    origin: OriginDependency,
    url: BaseUrlDependency,
) -> Response:
    """Store scans and photos (all or none) and start the process `register`."""

    async def subscribe(subscriber: Subscriber) -> Subscription:
        return await checked_subscription(subscriber, callbacks, url.url, settings)

    if media_type(request) != "multipart/form-data":
        raise UnsupportedMediaTypeError(
            "send multipart/form-data with fields `scan` and, if wanted, `photo`, `options`, `subscriber`"
        )
    intake = file_intake(belongings, adapters, settings, origin.make_id)
    form = _RegistrationForm(request, intake)
    now = datetime.now(UTC)
    work = register_uploads(REGISTER, intake, form, subscribe, now, origin)
    job = await unless_client_leaves(request, work, form.read)
    return created_job(job, url)


class _RegistrationForm:
    """Hand out the files as they arrive and keep the other fields, wherever in the form they stand."""

    def __init__(self, request: Request, intake: FileIntake) -> None:
        self._request = request
        self._intake = intake
        self._said: dict[str, bytes] = {}
        self._are_photos: list[bool] = []
        self._columns = stated_columns(request.headers.get(HEADER, ""), HEADER)
        self.read = asyncio.Event()
        """Set when all of the form has arrived."""

    def columns(self) -> str:
        return self._columns

    def files(self) -> AsyncIterator[Upload]:
        return marked(self._files(), self.read)

    async def _files(self) -> AsyncIterator[Upload]:
        length = declared_length(self._request) or 0
        await asyncio.to_thread(self._intake.require_room, length)
        await asyncio.to_thread(self._intake.require_quota, content_length(self._request))
        async for part in FormReader(self._request).parts():
            if part.name in {"scan", "photo"}:
                self._are_photos.append(part.name == "photo")
                yield Upload(require_filename(part.name, part.filename), part.chunks, part.at_most)
            elif part.name == FIELD and not self._columns:
                self._columns = await columns_of_form(part)
            elif part.name in ONCE and part.name not in self._said:
                self._said[part.name] = await read_within(f"the field `{part.name}`", part.chunks, MAX_OPTIONS_BYTES)
            else:
                raise _refused(part.name)

    def contents(self) -> FormContents:
        said: dict[str, Any] = {name: parse_json(text, f"/{name}") for name, text in self._said.items()}
        return FormContents(said.get("options", {}), said.get("subscriber"), self._are_photos)


def _refused(name: str) -> InvalidRequestError:
    detail = "unknown field; the form takes `scan` (several), `photo` (several), `columns`, `options` and `subscriber`"
    if name in {*ONCE, FIELD}:
        detail = f"the field `{name}` may stand in the form only once"
    return InvalidRequestError(detail, [FieldFault(pointer_to(name), detail)])
