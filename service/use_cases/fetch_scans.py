"""Scans that a request names by their address on another server: fetched, then files like any other."""

from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from copy import deepcopy
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from service.errors import AddressRefusedError, FieldFault, FileTooLargeError, InvalidRequestError, ServiceError
from service.ports import Sources, StepFailedError, StoredFile
from service.use_cases.describe_processes import OfferedProcess
from service.use_cases.identifiers import new_identifier
from service.use_cases.store_files import FileIntake, Upload
from service.use_cases.validate_request import WRONG_FIELDS, pointer_to, validated


@dataclass(frozen=True)
class _Reference:
    """A scan that is given by its address."""

    scan: dict[str, Any]
    """The place in the request."""
    pointer: str

    @property
    def href(self) -> str:
        return str(self.scan["href"])


@asynccontextmanager
async def with_fetched_scans(
    process: OfferedProcess, body: Any, intake: FileIntake, sources: Sources, now: datetime
) -> AsyncIterator[Any]:
    """Give the request with ids of files in place of addresses; the files go when what is done with it fails.

    Nothing is fetched before the rest of the request is known to be right, and each address only once.

    Raises
    ------
    InvalidRequestError
        With a pointer to every scan that cannot be fetched.
    FileTooLargeError, InsufficientStorageError
        A limit is reached.
    """
    if not any(True for _ in _references(body)):
        yield body
        return
    changed = deepcopy(body)
    references = list(_references(changed))
    _check(process, changed, references, sources)
    fetched: dict[str, StoredFile] = {}
    try:
        for each in references:
            if each.href not in fetched:
                fetched[each.href] = await _fetched(each, intake, sources, now)
            _replace(each.scan, fetched[each.href].id)
        yield changed
    except BaseException:
        intake.discard(list(fetched.values()))
        raise


def _references(body: Any) -> Iterator[_Reference]:
    inputs = body.get("inputs") if isinstance(body, dict) else None
    if not isinstance(inputs, dict):
        return
    stations = inputs.get("stations")
    places = [(("station",), inputs.get("station"))]
    places += [(("stations", k), each) for k, each in enumerate(stations if isinstance(stations, list) else [])]  # type: ignore[misc]
    for where, station in places:
        scan = station.get("scan") if isinstance(station, dict) else None
        if isinstance(scan, dict) and isinstance(scan.get("href"), str) and "file" not in scan:
            yield _Reference(scan, pointer_to("inputs", *where, "scan", "href"))


def _check(process: OfferedProcess, body: Any, references: Sequence[_Reference], sources: Sources) -> None:
    """Check all that can be checked before anything is fetched."""
    faults = []
    for each in references:
        try:
            sources.check(each.href)
        except AddressRefusedError as error:
            faults.append(FieldFault(each.pointer, str(error)))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)
    stand_in = deepcopy(body)
    for each in _references(stand_in):
        _replace(each.scan, new_identifier())
    validated(process.request_model, stand_in)


def _replace(scan: dict[str, Any], file_id: str) -> None:
    del scan["href"]
    scan["file"] = file_id


async def _fetched(reference: _Reference, intake: FileIntake, sources: Sources, now: datetime) -> StoredFile:
    async def uploads() -> AsyncIterator[Upload]:
        async with sources.opened(reference.href) as remote:
            limit = intake.settings.max_file_bytes
            if (remote.declared_bytes or 0) > limit:
                raise FileTooLargeError(remote.name, remote.declared_bytes or 0, limit)
            intake.require_room(remote.declared_bytes or 0)
            yield Upload(remote.name, remote.chunks)

    try:
        return (await intake.store(uploads(), now))[0]
    except (AddressRefusedError, StepFailedError) as error:
        raise _at(reference, error) from None
    except ServiceError as error:
        if error.status != InvalidRequestError.status:
            raise
        raise _at(reference, error) from None


def _at(reference: _Reference, error: ServiceError) -> InvalidRequestError:
    detail = str(error)
    if reference.href not in detail:
        detail = f"{reference.href}: {detail}"
    return InvalidRequestError(WRONG_FIELDS, [FieldFault(reference.pointer, detail)])
