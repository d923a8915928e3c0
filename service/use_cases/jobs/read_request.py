"""Read requests: small ones at once, large ones and texts of other programs in a process of their own."""

import asyncio
import re
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any, BinaryIO

from schemas.requests.subscriber import Subscriber
from schemas.values.texts_elsewhere import TextElsewhereError, texts_elsewhere
from service.errors import ComputationFailedError, FileTooLargeError
from service.names.identifiers import MakeIdentifier, is_identifier
from service.ports import Job, Json, JsonText, Process, RequestReader, Sources, Stored, StoredFile
from service.use_cases.inputs.fetch_files import Fetch, require_allowed, with_files_to_come
from service.use_cases.inputs.validate_request import parse_json
from service.use_cases.jobs.submit_job import Execution, check_execution
from service.use_cases.limits.machine_shares import CHECK_REQUEST
from service.use_cases.uploads.inspection_places import request_place

SMALL_BYTES = 1_000_000
"""What is read here."""
TIMEOUT_S = 60.0
NAMES = (b'"file"', b'"jobID"')
"""Members that name files and jobs."""
IDENTIFIER = re.compile(rb'\s*:\s*"([A-Za-z0-9_-]{1,64})"')
GIVES_STATIONS = "register"


class RequestDesk:
    """Reads requests of one project.

    Parameters
    ----------
    stored, sources
        What there is, and which addresses are allowed.
    owner
        The project.
    make_id
        Makes identifiers of files to come.
    elsewhere
        Reads what is not read here; None: all is.
    """

    def __init__(
        self, stored: Stored, sources: Sources, owner: str, make_id: MakeIdentifier, elsewhere: RequestReader | None
    ) -> None:
        self._stored, self._sources, self._owner = stored, sources, owner
        self._make_id, self._elsewhere = make_id, elsewhere

    async def execution(self, process: Process[Any], body: BinaryIO, size: int, *, at_once: bool) -> Execution:
        """Return the validated request.

        Parameters
        ----------
        process
            What is asked for.
        body, size
            Of the request; a file that is read from its beginning.
        at_once
            Whether it is answered at once.

        Raises
        ------
        InvalidRequestError
            With a pointer to every bad field.
        FileTooLargeError
            What is answered at once is read here, and too large for it.
        BusyError
            Others of the project, or of the machine, are read, and it took too long until their end.
        """
        if self._elsewhere is None:
            return await asyncio.to_thread(self._read_here, process, body)
        if at_once and process.answer is not None and size > SMALL_BYTES:
            raise FileTooLargeError("a request that is answered at once", size, SMALL_BYTES)
        if size <= SMALL_BYTES:
            try:
                with texts_elsewhere():
                    return await asyncio.to_thread(self._read_here, process, body)
            except TextElsewhereError:
                pass
        async with request_place(self._stored.settings, self._owner):
            return await self._read_elsewhere(self._elsewhere, process, body)

    def _read_here(self, process: Process[Any], body: BinaryIO) -> Execution:
        body.seek(0)
        document, fetches = with_files_to_come(parse_json(body.read()), self._make_id)
        require_allowed(fetches, self._sources)
        return check_execution(process, document, self._stored, fetches)

    async def _read_elsewhere(self, reader: RequestReader, process: Process[Any], body: BinaryIO) -> Execution:
        arguments = await asyncio.to_thread(self._arguments, process, body)
        output, made = await reader.read(CHECK_REQUEST, arguments, body, timeout_s=TIMEOUT_S)
        fetches = tuple(Fetch.from_json(each) for each in output["fetches"])
        require_allowed(fetches, self._sources)
        to_come = {fetch.id for fetch in fetches}
        known = {each["id"] for each in arguments["files"]} | to_come
        if not (known.issuperset(output["file_ids"]) and to_come.issubset(arguments["identifiers"])):
            raise ComputationFailedError("the process that reads requests names files that it was not told of")
        said = output["subscriber"]
        return Execution(
            process,
            JsonText(made.decode()),
            tuple(output["file_ids"]),
            None if output["outputs"] is None else tuple(output["outputs"]),
            bool(output["raw"]),
            None if said is None else Subscriber.model_validate(said),
            fetches,
            output["files"],
        )

    def _arguments(self, process: Process[Any], body: BinaryIO) -> Json:
        """Return what a process needs to know that can ask no store: all files and jobs that the request may mean."""
        body.seek(0)
        text = body.read()
        named = sorted(set(_named(text)))
        files = [file for file in map(self._stored.files.get, named) if file is not None]
        jobs = [job for job in map(self._stored.jobs.get, named) if job is not None]
        whole = [self._stored.jobs.whole(job.id) if job.process_id == GIVES_STATIONS else job for job in jobs]
        return {
            "process_id": process.id,
            "identifiers": [self._make_id() for _ in range(text.count(b'"href"'))],
            "files": [_file(file) for file in files],
            "jobs": [_job(job) for job in whole if job is not None],
            "settings": self._stored.settings.model_dump(mode="json", exclude={"database_url", "callback_secret"}),
        }


def _named(text: bytes) -> Iterator[str]:
    """Yield what a request names; no pattern is tried where none of the members stands, which would take far longer."""
    for name in NAMES:
        place = text.find(name)
        while place >= 0:
            found = IDENTIFIER.match(text, place + len(name))
            if found is not None and is_identifier(identifier := found[1].decode()):
                yield identifier
            place = text.find(name, place + len(name))


def _file(file: StoredFile) -> Json:
    times = {"created": file.created.isoformat(), "expires": file.expires and file.expires.isoformat()}
    return {**asdict(file), **times}


def _job(job: Job) -> Json:
    said = {"id": job.id, "process_id": job.process_id, "inputs": job.inputs, "status": job.status.value}
    return {**said, "created": job.created.isoformat()}
