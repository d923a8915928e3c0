"""Turn an execution request into a job on the queue, or into an answer at once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

from pydantic import BaseModel

from algorithms.scans.open3d_loading import missing_for_open3d
from schemas.requests.subscriber import Subscriber
from schemas.values.file_references import FileReference
from service.errors import FieldFault, InvalidRequestError
from service.names.identifiers import MakeIdentifier, new_identifier
from service.ports import USUAL_URGENCY, Job, JobStatus, Json, JsonText, Process, Stored, Subscription, as_text
from service.settings import Settings
from service.use_cases.access.sealed_secrets import seal_of
from service.use_cases.inputs.fetch_files import Fetch, without_absence
from service.use_cases.inputs.stations_of_jobs import with_stations_of_jobs
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to, validated
from service.use_cases.limits.quotas import Belongings, admit_job


@dataclass(frozen=True)
class Execution:
    """A validated execution request."""

    process: Process[Any]
    inputs: Json | JsonText
    """As in the request, defaults filled in."""
    file_ids: tuple[str, ...]
    outputs: tuple[str, ...] | None
    """Wanted outputs; None for all."""
    raw: bool
    subscriber: Subscriber | None
    """Who is to be told how the job goes, not checked yet."""
    fetches: tuple[Fetch, ...] = ()
    """What the job fetches before anything else."""
    files: Mapping[str, Json] = field(default_factory=dict)
    """Of the wanted outputs those that are files, and how each is wanted."""


def check_execution(process: Process[Any], body: Any, stored: Stored, fetches: tuple[Fetch, ...] = ()) -> Execution:
    """Validate a parsed request body against the process and what is stored.

    Parameters
    ----------
    process, body
        What is to be run, and how.
    stored
        What there is, and limits.
    fetches
        Files that the job will fetch; the body has their identifiers already.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    MissingLibraryError
        This machine lacks a library without which it cannot be computed.
    """
    request = validated(process.request_model, body)
    wanted = request.wanted()
    unknown = [name for name in wanted if name not in process.output_names]
    if unknown:
        raise InvalidRequestError(
            WRONG_FIELDS,
            [FieldFault(pointer_to("outputs", name), f"'{process.id}' has no such output") for name in unknown],
        )
    inputs = with_stations_of_jobs(request.inputs, stored)
    if process.needs_open3d(inputs, request.wanted_files()) and (missing := missing_for_open3d()) is not None:
        raise missing
    try:
        process.check(inputs, stored)
        process.check_files(inputs, request.wanted_files())
    except InvalidRequestError as error:
        other = without_absence(error, fetches)
        if other is not None:
            raise other from None
    return Execution(
        process,
        _as_stored(process, inputs),
        _files_of(inputs),
        wanted or None,
        request.response == "raw",
        request.subscriber,
        fetches,
        {name: asked.model_dump(mode="json", by_alias=True) for name, asked in request.wanted_files().items()},
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
    written = execution.inputs if isinstance(execution.inputs, JsonText) else None
    job = Job(
        id=origin.make_id(),
        process_id=execution.process.id,
        inputs={} if isinstance(execution.inputs, JsonText) else execution.inputs,
        status=JobStatus.ACCEPTED,
        created=now,
        updated=now,
        message="; ".join(["waiting for a worker", *remarks]),
        file_ids=execution.file_ids,
        wanted=_wanted(execution),
        fetches=tuple(fetch.to_json() for fetch in execution.fetches),
        subscriber=None if subscription is None else _kept(subscription, settings, belongings.owner),
        urgency=origin.urgency,
        request_id=origin.request_id,
    )
    made_before = belongings.jobs.get(job.id)
    if made_before is None:
        belongings.require_within(settings)
        belongings.require_record(settings, len(as_text(execution.inputs)))
        belongings.jobs.create_and_enqueue(job, admit_job(settings), written, _weight(execution, job, settings))
    return made_before or job


async def answer_at_once(execution: Execution) -> Json | None:
    """Give the wanted outputs of a process that answers at once; None for all others."""
    if execution.process.answer is None or isinstance(execution.inputs, JsonText):
        return None
    outputs = await execution.process.answer(execution.inputs)
    return {name: outputs[name] for name in execution.outputs or outputs if name in outputs}


def _weight(execution: Execution, job: Job, settings: Settings) -> float:
    """Estimate how much a job takes, where its place among others depends on it."""
    if not settings.gives_steps or isinstance(execution.inputs, JsonText):
        return 0.0
    of_job = {"id": job.id, "process_id": job.process_id, "inputs": job.inputs, "fetches": list(job.fetches)}
    return execution.process.plan.total_weight({**of_job, "wanted": dict(execution.files), "files": {}})


def _kept(subscription: Subscription, settings: Settings, owner: str) -> Json:
    """Give what is stored of a subscription."""
    seal = seal_of(settings) if subscription.secret else None
    if seal is not None:
        subscription = replace(subscription, secret=seal.sealed(subscription.secret, owner))
    return subscription.to_json()


def _wanted(execution: Execution) -> Json | None:
    if execution.outputs is None and not execution.raw:
        return None
    wanted = {"outputs": None if execution.outputs is None else list(execution.outputs), "raw": execution.raw}
    return {**wanted, "files": dict(execution.files)} if execution.files else wanted


def _as_stored(process: Process[Any], inputs: BaseModel) -> Json:
    """Give the inputs as JSON; what answers at once gives back what came in, others are stored with their defaults."""
    return inputs.model_dump(mode="json", by_alias=True, exclude_unset=process.synchronous)


def _files_of(inputs: BaseModel) -> tuple[str, ...]:
    """List the files that inputs name, each once."""
    return tuple(dict.fromkeys(reference.file for reference in _references(inputs)))


def _references(part: Any) -> Iterator[FileReference]:
    if isinstance(part, FileReference):
        yield part
    if isinstance(part, BaseModel):
        for name in type(part).model_fields:
            yield from _references(getattr(part, name))
    elif isinstance(part, list | tuple):
        for each in part:
            yield from _references(each)
    elif isinstance(part, dict):
        for each in part.values():
            yield from _references(each)
