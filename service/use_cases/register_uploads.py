"""Store uploaded scans and photos and register them: one request for `curl`."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from service.errors import FieldFault, InvalidRequestError
from service.ports import Job, JobStore, StoredFile
from service.use_cases.describe_processes import offered_process
from service.use_cases.store_files import FileIntake, Upload
from service.use_cases.submit_job import ANY_REQUEST, Origin, check_execution, submit_job
from service.use_cases.uploaded_stations import UploadedFile, stations_of_uploads


@dataclass(frozen=True)
class FormContents:
    """What is known of a form when all of it has arrived."""

    options: Any
    """The other inputs of `register` (or ``{"inputs": …}``), parsed JSON."""
    are_photos: Sequence[bool]
    """Of each file, in the order of the form, whether it came as a photo."""


async def register_uploads(
    intake: FileIntake,
    jobs: JobStore,
    uploads: AsyncIterator[Upload],
    contents: Callable[[], FormContents],
    now: datetime,
    origin: Origin = ANY_REQUEST,
) -> Job:
    """Store the files, then start `register` with one station per scan, named S1, S2, … unless the options name them.

    Parameters
    ----------
    intake, jobs
        Where files and jobs go.
    uploads
        The files on their way in.
    contents
        Gives the rest of the form once all uploads have arrived.
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
        return await asyncio.to_thread(_submit, intake, jobs, files, contents(), now, origin)
    except BaseException:
        intake.discard(files)
        raise


def _submit(
    intake: FileIntake,
    jobs: JobStore,
    files: Sequence[StoredFile],
    contents: FormContents,
    now: datetime,
    origin: Origin,
) -> Job:
    came = [UploadedFile(file.id, file.name, file.scans, file.photos) for file in files]
    photos = [file for file, is_photo in zip(came, contents.are_photos, strict=True) if is_photo]
    scans = [file for file, is_photo in zip(came, contents.are_photos, strict=True) if not is_photo]
    count = sum(len(file.scans) for file in scans)
    if count < 2:
        detail = f"a registration needs at least two scans, {count} came"
        raise InvalidRequestError(detail, [FieldFault("/scan", detail)])
    inputs = _inputs(contents.options)
    listed = inputs.get("stations")
    try:
        stations = stations_of_uploads(listed, scans, photos, [f"S{number}" for number in range(1, count + 1)])
    except InvalidRequestError as error:
        raise InvalidRequestError(str(error), [_in_options(fault) for fault in error.faults]) from None
    body = {"inputs": {**inputs, "stations": stations}}
    try:
        execution = check_execution(offered_process("register"), body, intake.files, intake.settings)
    except InvalidRequestError as error:
        told = len(listed or [])
        raise InvalidRequestError(str(error), [_in_form(fault, told) for fault in error.faults]) from None
    return submit_job(execution, jobs, intake.settings, now, origin=origin)


def _inputs(options: Any) -> Mapping[str, Any]:
    inputs = options["inputs"] if isinstance(options, dict) and options.keys() == {"inputs"} else options
    if not isinstance(inputs, dict):
        detail = "the options are a JSON object"
        raise InvalidRequestError(detail, [FieldFault("/options", detail)])
    return inputs


def _in_options(fault: FieldFault) -> FieldFault:
    """Point to the stations of the options; scans and photos are fields of the form themselves."""
    in_list = fault.pointer.startswith("/stations")
    return FieldFault("/options" + fault.pointer, fault.detail) if in_list else fault


def _in_form(fault: FieldFault, told: int) -> FieldFault:
    """Point into the form instead of the body of an execution request; `told` stations stand in the options."""
    path = fault.pointer.removeprefix("/inputs")
    _, first, *rest = path.split("/")
    made = first == "stations" and int(rest[0] if rest else 0) >= told
    return FieldFault("/scan" if made else "/options" + path, fault.detail)
