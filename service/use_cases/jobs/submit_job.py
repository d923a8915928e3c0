"""Turn an execution request into a job on the queue, or into an answer at once."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from pydantic import BaseModel

from schemas.detect_edges_inputs import DetectEdgesInputs
from schemas.extract_lines_inputs import ExtractLinesInputs
from schemas.register_inputs import RegisterInputs, Station
from schemas.subscriber import Subscriber
from service.errors import FieldFault, InvalidRequestError
from service.names.identifiers import MakeIdentifier, new_identifier
from service.ports import USUAL_URGENCY, FileStore, Job, JobStatus, Json, Subscription
from service.settings import Settings
from service.use_cases.inputs.check_photos import check_photo
from service.use_cases.inputs.check_stations import check_register_inputs, check_station
from service.use_cases.inputs.fetch_files import Fetch, without_absence
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to, validated
from service.use_cases.jobs.describe_processes import OfferedProcess
from service.use_cases.limits.quotas import Belongings, admit_job


@dataclass(frozen=True)
class Execution:
    """A validated execution request."""

    process: OfferedProcess
    inputs: Json
    """As in the request, defaults filled in."""
    file_ids: tuple[str, ...]
    outputs: tuple[str, ...] | None
    """Wanted outputs; None for all."""
    raw: bool
    subscriber: Subscriber | None
    """Who is to be told how the job goes, not checked yet."""
    fetches: tuple[Fetch, ...] = ()
    """What the job fetches before anything else."""


def check_execution(
    process: OfferedProcess, body: Any, files: FileStore, settings: Settings, fetches: tuple[Fetch, ...] = ()
) -> Execution:
    """Validate a parsed request body against the process and what is stored.

    Parameters
    ----------
    process, body
        What is to be run, and how.
    files, settings
        What there is, and limits.
    fetches
        Files that the job will fetch; the body has their identifiers already.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    """
    request = validated(process.request_model, body)
    unknown = [name for name in request.outputs or {} if name not in _output_names(process)]
    if unknown:
        raise InvalidRequestError(
            WRONG_FIELDS,
            [FieldFault(pointer_to("outputs", name), f"'{process.id}' has no such output") for name in unknown],
        )
    try:
        check_files(request.inputs, files, settings)
    except InvalidRequestError as error:
        other = without_absence(error, fetches)
        if other is not None:
            raise other from None
    return Execution(
        process,
        _as_stored(process, request.inputs),
        _files_of(request.inputs),
        tuple(request.outputs) if request.outputs else None,
        request.response == "raw",
        request.subscriber,
        fetches,
    )


@dataclass(frozen=True)
class Origin:
    """The request that makes a job."""

    make_id: MakeIdentifier = new_identifier
    request_id: str = ""
    """By which the log knows it."""
    urgency: int = USUAL_URGENCY
    """0 (first) to 7 (last)."""


ANY_REQUEST = Origin()


def submit_job(
    execution: Execution,
    belongings: Belongings,
    settings: Settings,
    now: datetime,
    subscription: Subscription | None = None,
    origin: Origin = ANY_REQUEST,
    remarks: Sequence[str] = (),
) -> Job:
    """Write the job and put it on the queue, both or neither; a request that is tried again gets the job it has made.

    Parameters
    ----------
    execution
        What is to be run.
    belongings, settings
        Where to, what there is, and how much there may be.
    now
        Time of the request.
    subscription
        Who is told how it goes.
    origin
        The request.
    remarks
        What the client is told at once besides.

    Raises
    ------
    QuotaExceededError
        Too many jobs wait already.
    QuotaFullError, InsufficientStorageError
        The project has stored too much already, or the disk is nearly full.
    """
    job = Job(
        id=origin.make_id(),
        process_id=execution.process.id,
        inputs=execution.inputs,
        status=JobStatus.ACCEPTED,
        created=now,
        updated=now,
        message="; ".join(["waiting for a worker", *remarks]),
        file_ids=execution.file_ids,
        wanted=_wanted(execution),
        fetches=tuple(fetch.to_json() for fetch in execution.fetches),
        subscriber=None if subscription is None else subscription.to_json(),
        urgency=origin.urgency,
        request_id=origin.request_id,
    )
    made_before = belongings.jobs.get(job.id)
    if made_before is None:
        belongings.require_within(settings)
        belongings.require_record(settings, len(json.dumps(job.inputs)))
        belongings.jobs.create_and_enqueue(job, admit_job(settings))
    return made_before or job


def answer_at_once(execution: Execution) -> Json:
    """Give the outputs of `echo`: its inputs, or the wanted ones of them."""
    wanted = execution.outputs or tuple(execution.inputs)
    return {name: execution.inputs[name] for name in wanted if name in execution.inputs}


def _wanted(execution: Execution) -> Json | None:
    if execution.outputs is None and not execution.raw:
        return None
    return {"outputs": None if execution.outputs is None else list(execution.outputs), "raw": execution.raw}


def _output_names(process: OfferedProcess) -> set[str]:
    return {field.serialization_alias or name for name, field in process.outputs.model_fields.items()}


def _as_stored(process: OfferedProcess, inputs: BaseModel) -> Json:
    """Give the inputs as JSON; `echo` gives back only what came in, the others are stored with their defaults."""
    return inputs.model_dump(mode="json", by_alias=True, exclude_unset=process.synchronous)


def check_files(inputs: BaseModel, files: FileStore, settings: Settings) -> None:
    """Check the files that validated inputs name, and whatever else a schema cannot know.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    """
    if isinstance(inputs, RegisterInputs):
        check_register_inputs(inputs, files, settings.max_stations)
    elif isinstance(inputs, ExtractLinesInputs):
        check_station(inputs.station, files)
    elif isinstance(inputs, DetectEdgesInputs):
        check_photo(inputs.photo, files)


def _files_of(inputs: BaseModel) -> tuple[str, ...]:
    """List the files of scans and photos, each once."""
    stations: Sequence[Station] = ()
    if isinstance(inputs, RegisterInputs):
        stations = inputs.stations
    elif isinstance(inputs, ExtractLinesInputs):
        stations = [inputs.station]
    elif isinstance(inputs, DetectEdgesInputs):
        return (inputs.photo.file,)
    files = [file for each in stations for file in (each.scan.file, *(photo.file for photo in each.photos))]
    return tuple(dict.fromkeys(files))
