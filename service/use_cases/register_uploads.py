"""Store uploaded scans and photos and register them: one request for `curl`."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from schemas.subscriber import Subscriber
from service.errors import FieldFault, InvalidRequestError
from service.ports import Job, StoredFile, Subscription
from service.use_cases.describe_processes import offered_process
from service.use_cases.store_files import FileIntake, Upload
from service.use_cases.submit_job import ANY_REQUEST, Execution, Origin, check_execution, submit_job
from service.use_cases.upload_threads import undisturbed
from service.use_cases.uploaded_stations import UploadedFile, stations_of_uploads


@dataclass(frozen=True)
class FormContents:
    """What is known of a form when all of it has arrived."""

    options: Any
    """The other inputs of `register`, or a whole request for its execution (``{"inputs": …}``), parsed JSON."""
    subscriber: Any
    """Who is to be told how the job goes, parsed JSON; None: as the options say."""
    are_photos: Sequence[bool]
    """Of each file, in the order of the form, whether it came as a photo."""


async def register_uploads(
    intake: FileIntake,
    uploads: AsyncIterator[Upload],
    contents: Callable[[], FormContents],
    subscribe: Callable[[Subscriber], Awaitable[Subscription]],
    now: datetime,
    origin: Origin = ANY_REQUEST,
) -> Job:
    """Store the files, then start `register` with one station per scan, named S1, S2, … unless the options name them.

    Parameters
    ----------
    intake
        Where files go, and beside them the job.
    uploads
        The files on their way in.
    contents
        Gives the rest of the form once all uploads have arrived.
    subscribe
        Checks whom the job is to tell how it goes.
    now
        Time of the request.
    origin
        The request.

    Raises
    ------
    InvalidRequestError
        Fewer than two scans came, a photo belongs to no station, or an option is wrong; no file is kept then.
    """
    files = await intake.store(uploads, now)
    try:
        form = await asyncio.to_thread(contents)
        execution = await asyncio.to_thread(_execution, intake, files, form)
        subscription = None
        if execution.subscriber is not None:
            with _pointing_into(form):
                subscription = await subscribe(execution.subscriber)
        return await asyncio.to_thread(
            submit_job, execution, intake.belongings, intake.settings, now, subscription, origin
        )
    except BaseException:
        await undisturbed(intake.discard, files)
        raise


def _execution(intake: FileIntake, files: Sequence[StoredFile], contents: FormContents) -> Execution:
    """Check what the form asks for, as if its files had been uploaded before."""
    came = [UploadedFile(file.id, file.name, file.scans, file.photos) for file in files]
    photos = [file for file, is_photo in zip(came, contents.are_photos, strict=True) if is_photo]
    scans = [file for file, is_photo in zip(came, contents.are_photos, strict=True) if not is_photo]
    count = sum(len(file.scans) for file in scans)
    if count < 2:
        detail = f"a registration needs at least two scans, {count} came"
        raise InvalidRequestError(detail, [FieldFault("/scan", detail)])
    request = _request(contents)
    inputs = request["inputs"]
    listed = inputs.get("stations")
    try:
        stations = stations_of_uploads(listed, scans, photos, [f"S{number}" for number in range(1, count + 1)])
    except InvalidRequestError as error:
        raise InvalidRequestError(str(error), [_in_options(fault) for fault in error.faults]) from None
    body = {**request, "inputs": {**inputs, "stations": stations}}
    with _pointing_into(contents, len(listed or [])):
        return check_execution(offered_process("register"), body, intake.files, intake.settings)


def _request(contents: FormContents) -> dict[str, Any]:
    """Give the request for an execution that the form is; what it says of stations is not read yet."""
    options = contents.options
    request = options if isinstance(options, dict) and "inputs" in options else {"inputs": options}
    if not isinstance(request["inputs"], dict):
        detail = "the options are a JSON object"
        raise InvalidRequestError(detail, [FieldFault("/options", detail)])
    if contents.subscriber is None:
        return request
    if "subscriber" in request:
        detail = "the options name a subscriber already"
        raise InvalidRequestError(detail, [FieldFault("/subscriber", detail)])
    return {**request, "subscriber": contents.subscriber}


def _in_options(fault: FieldFault) -> FieldFault:
    """Point to the stations of the options; scans and photos are fields of the form themselves."""
    in_list = fault.pointer.startswith("/stations")
    return FieldFault("/options" + fault.pointer, fault.detail) if in_list else fault


@contextmanager
def _pointing_into(contents: FormContents, told: int = 0) -> Iterator[None]:
    """Point into the form instead of the body of an execution request; `told` stations stand in the options."""
    try:
        yield
    except InvalidRequestError as error:
        faults = [FieldFault(_place(contents, fault.pointer, told), fault.detail) for fault in error.faults]
        raise InvalidRequestError(str(error), faults) from None


def _place(contents: FormContents, pointer: str, told: int) -> str:
    first, *rest = pointer.split("/")[1:] or [""]
    if first == "subscriber" and contents.subscriber is not None:
        return pointer
    if first == "inputs" and rest[:1] == ["stations"] and int(rest[1] if len(rest) > 1 else 0) >= told:
        return "/scan"
    return "/options" + pointer.removeprefix("/inputs")
