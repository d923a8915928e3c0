"""Reading of a large request in a process of its own: what it says may be hostile."""

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Any, cast

from service.errors import InvalidRequestError
from service.ports import (
    REQUEST_BODY,
    REQUEST_INPUTS,
    FileStore,
    Job,
    JobStatus,
    JobStore,
    Json,
    StepContext,
    Stored,
    StoredFile,
)
from service.processes import offered_process
from service.settings import Settings
from service.use_cases.inputs.fetch_files import with_files_to_come
from service.use_cases.inputs.validate_request import parse_json
from service.use_cases.jobs.submit_job import check_execution


def check_request(context: StepContext, arguments: Json) -> Json:
    """Read and check a request; what it asks for is handed back, its inputs as a blob.

    Parameters
    ----------
    context
        Has the body.
    arguments
        `process_id`; `identifiers` for files to come; `files` and `jobs` that the body may mean; `settings` that limit
        it.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    """
    identifiers = iter(arguments["identifiers"])
    body = parse_json(context.blobs.local_path(REQUEST_BODY).read_bytes())
    body, fetches = with_files_to_come(body, lambda: _next(identifiers))
    execution = check_execution(offered_process(arguments["process_id"]), body, _stored(arguments), fetches)
    context.blobs.write_bytes(REQUEST_INPUTS, json.dumps(execution.inputs).encode())
    subscriber = execution.subscriber
    return {
        "file_ids": execution.file_ids,
        "outputs": execution.outputs,
        "raw": execution.raw,
        "subscriber": None if subscriber is None else subscriber.model_dump(mode="json", by_alias=True),
        "fetches": [fetch.to_json() for fetch in fetches],
        "files": dict(execution.files),
    }


def _next(identifiers: Iterator[str]) -> str:
    found = next(identifiers, None)
    if found is None:
        raise InvalidRequestError("addresses of files stand in members called `href`, written without escapes")
    return found


class _Known:
    """Files or jobs that were looked up before, by identifier."""

    def __init__(self, found: dict[str, Any]) -> None:
        self._found = found
        self.get = self.whole = found.get


def _stored(arguments: Json) -> Stored:
    files = {each["id"]: _file(each) for each in arguments["files"]}
    jobs = {each["id"]: _job(each) for each in arguments["jobs"]}
    # nothing else of the stores is asked for while a request is checked
    return Stored(cast("FileStore", _Known(files)), cast("JobStore", _Known(jobs)), Settings(**arguments["settings"]))


def _file(said: Json) -> StoredFile:
    times = {name: datetime.fromisoformat(said[name]) for name in ("created", "expires") if said[name] is not None}
    listed = {name: tuple(said[name]) for name in ("scans", "photos")}
    return StoredFile(**{**said, **times, **listed})


def _job(said: Json) -> Job:
    return Job(**{**said, "status": JobStatus(said["status"]), "created": datetime.fromisoformat(said["created"])})
