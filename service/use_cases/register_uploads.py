"""Store uploaded scans and register them: one request for `curl`."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from datetime import datetime
from typing import Any

from service.errors import FieldFault, InvalidRequestError
from service.ports import Job, JobStore, StoredFile
from service.use_cases.describe_processes import offered_process
from service.use_cases.store_files import FileIntake, Upload
from service.use_cases.submit_job import check_execution, submit_job


async def register_uploads(
    intake: FileIntake,
    jobs: JobStore,
    uploads: AsyncIterator[Upload],
    options: Callable[[], Any],
    now: datetime,
) -> Job:
    """Store the scans, then start `register` with one station per scan, named S1, S2, … in their order.

    Parameters
    ----------
    intake, jobs
        Where files and jobs go.
    uploads
        The scan files on their way in.
    options
        Gives the other inputs of `register` (or ``{"inputs": …}``) once all uploads have arrived.
    now
        Time of the request.

    Raises
    ------
    InvalidRequestError
        Fewer than two scans came, or an option is wrong; no file is kept then.
    """
    files = await intake.store(uploads, now)
    try:
        return await asyncio.to_thread(_submit, intake, jobs, files, options(), now)
    except BaseException:
        intake.discard(files)
        raise


def _submit(intake: FileIntake, jobs: JobStore, files: Sequence[StoredFile], options: Any, now: datetime) -> Job:
    scans = [{"file": file.id, "index": scan["index"]} for file in files for scan in file.scans]
    if len(scans) < 2:
        detail = f"a registration needs at least two scans, {len(scans)} came"
        raise InvalidRequestError(detail, [FieldFault("/scan", detail)])
    stations = [{"name": f"S{number}", "scan": scan} for number, scan in enumerate(scans, start=1)]
    body = {"inputs": {**_inputs(options), "stations": stations}}
    try:
        execution = check_execution(offered_process("register"), body, intake.files, intake.settings)
    except InvalidRequestError as error:
        raise InvalidRequestError(str(error), [_in_form(fault) for fault in error.faults]) from None
    return submit_job(execution, jobs, intake.settings, now)


def _inputs(options: Any) -> Mapping[str, Any]:
    inputs = options["inputs"] if isinstance(options, dict) and options.keys() == {"inputs"} else options
    if not isinstance(inputs, dict):
        detail = "the options are a JSON object"
        raise InvalidRequestError(detail, [FieldFault("/options", detail)])
    if "stations" in inputs:
        detail = "the stations are made of the uploaded scans and are named S1, S2, … in their order"
        raise InvalidRequestError(detail, [FieldFault("/options/stations", detail)])
    return inputs


def _in_form(fault: FieldFault) -> FieldFault:
    """Point into the form instead of the body of an execution request."""
    path = fault.pointer.removeprefix("/inputs")
    return FieldFault("/scan" if path.startswith("/stations") else "/options" + path, fault.detail)
