"""Store uploaded scans and photos and register them: one request for `curl`."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Protocol

from schemas.requests.subscriber import Subscriber
from service.errors import FieldFault, InvalidRequestError
from service.ports import Job, Json, Process, Stored, StoredFile, Subscription
from service.use_cases.documents.scan_warnings import is_usable, left_out
from service.use_cases.jobs.submit_job import ANY_REQUEST, Execution, Origin, check_execution, submit_job
from service.use_cases.jobs.uploaded_stations import (
    UploadedFile,
    names_of_scans,
    numbered_name,
    stations_of_uploads,
)
from service.use_cases.uploads.store_files import FileIntake, Upload
from service.use_cases.uploads.upload_threads import undisturbed


@dataclass(frozen=True)
class FormContents:
    """What is known of a form when all of it has arrived."""

    options: Any
    """The other inputs of `register`, or a whole request for its execution (``{"inputs": …}``), parsed JSON."""
    subscriber: Any
    """Who is to be told how the job goes, parsed JSON; None: as the options say."""
    are_photos: Sequence[bool]
    """Of each file, in the order of the form, whether it came as a photo."""


class UploadForm(Protocol):
    """A form on its way in."""

    def files(self) -> AsyncIterator[Upload]:
        """Hand out the files as they arrive."""

    def columns(self) -> str:
        """Give what was said of the columns of text tables, once all has arrived."""

    def contents(self) -> FormContents:
        """Give the rest of the form, once all has arrived."""


async def register_uploads(
    register: Process[Any],
    intake: FileIntake,
    form: UploadForm,
    subscribe: Callable[[Subscriber], Awaitable[Subscription]],
    now: datetime,
    origin: Origin = ANY_REQUEST,
) -> Job:
    """Store the files, then start `register` with one station per scan, named after its file or by the options.

    Parameters
    ----------
    register
        The process that is run.
    intake
        Where files go, and beside them the job.
    form
        The files on their way in, and the rest.
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
    files = await intake.store(form.files(), now, form.columns)
    try:
        contents = await asyncio.to_thread(form.contents)
        execution = await asyncio.to_thread(_execution, register, intake, files, contents)
        subscription = None
        if execution.subscriber is not None:
            with _pointing_into(contents):
                subscription = await subscribe(execution.subscriber)
        remarks = [text for file in files for text in left_out(file.name, file.scans)]
        return await asyncio.to_thread(
            submit_job, execution, intake.belongings, intake.settings, now, subscription, origin, remarks
        )
    except BaseException:
        await undisturbed(intake.discard, files)
        raise


def _execution(
    register: Process[Any], intake: FileIntake, files: Sequence[StoredFile], contents: FormContents
) -> Execution:
    """Check what the form asks for, as if its files had been uploaded before."""
    came = [UploadedFile(file.id, file.name, file.scans, file.photos) for file in files]
    photos = [file for file, is_photo in zip(came, contents.are_photos, strict=True) if is_photo]
    scans = [file for file, is_photo in zip(came, contents.are_photos, strict=True) if not is_photo]
    count = sum(is_usable(scan) for file in scans for scan in file.scans)
    if count < 2:
        detail = "; ".join(
            [f"a registration needs at least two scans, {count} came"]
            + [text for file in files for text in left_out(file.name, file.scans)]
        )
        raise InvalidRequestError(detail, [FieldFault("/scan", detail)])
    request = _request(contents)
    inputs, unit = _without_unit(request["inputs"])
    listed = inputs.get("stations")
    try:
        names = names_of_scans(scans)
        stations = stations_of_uploads(listed, scans, photos, names)
    except InvalidRequestError as error:
        raise InvalidRequestError(str(error), [_in_options(fault) for fault in error.faults]) from None
    for station in stations if unit is not None else ():
        if isinstance(station.get("scan"), dict):
            station["scan"].setdefault("unit", unit)
    body = {**request, "inputs": {**_by_names(inputs, stations, names), "stations": stations}}
    stored = Stored(intake.files, intake.belongings.jobs, intake.settings)
    with _pointing_into(contents, len(listed or [])):
        return check_execution(register, body, stored)


def _by_names(inputs: dict[str, Any], stations: Sequence[Json], names: Sequence[str]) -> dict[str, Any]:
    """Put names in the place of numbers (S1, S2, …) that no station is called, in what the options say of pairs.

    A client that does not wish to work out names from those of its files numbers its scans.
    """
    called = {station.get("name") for station in stations if isinstance(station.get("name"), str)}
    renamed = {
        numbered_name(k): name for k, name in enumerate(names) if numbered_name(k) not in called and name in called
    }
    given = dict(inputs)
    if isinstance(given.get("pairs"), list):
        given["pairs"] = [
            [renamed.get(end, end) if isinstance(end, str) else end for end in pair] if isinstance(pair, list) else pair
            for pair in given["pairs"]
        ]
    if isinstance(given.get("reference"), dict):
        given["reference"] = {renamed.get(name, name): pose for name, pose in given["reference"].items()}
    return given


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


def _without_unit(inputs: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """Take out of the options the unit that is stated for all scans at once."""
    return {name: value for name, value in inputs.items() if name != "unit"}, inputs.get("unit")


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
