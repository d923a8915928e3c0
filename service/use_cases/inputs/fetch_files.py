"""Files that a request names by their address on another server: the job fetches them before anything else."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any

from service.errors import AddressRefusedError, FieldFault, InvalidRequestError, Problem, ServiceError, to_problem
from service.names.identifiers import MakeIdentifier
from service.ports import Json, Sources
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to


@dataclass(frozen=True)
class Fetch:
    """One file to come."""

    id: str
    """Identifier that it will have."""
    href: str
    pointers: tuple[str, ...]
    """Where the request names it: the objects with `href`, which get `file` instead."""
    label: str
    """What a person reads while it is fetched."""
    columns: str = ""
    """What the request says that the columns of a text table are."""

    def to_json(self) -> Json:
        """Give what is stored of it."""
        stored = {**asdict(self), "pointers": list(self.pointers)}
        return {name: value for name, value in stored.items() if name != "columns" or value}

    @classmethod
    def from_json(cls, stored: Json) -> "Fetch":
        """Read what `to_json` gave."""
        return cls(**{**stored, "pointers": tuple(stored["pointers"])})


def with_files_to_come(body: Any, make_id: MakeIdentifier) -> tuple[Any, tuple[Fetch, ...]]:
    """Give the request with identifiers in place of addresses, and what is to be fetched: each address once.

    Parameters
    ----------
    body
        Parsed request; whatever has not the form of a reference by address stays as it is, to be refused as such.
    make_id
        Makes the identifiers.
    """
    if next(_references(body), None) is None:
        return body, ()
    changed = deepcopy(body)
    fetches: dict[str, Fetch] = {}
    for reference, pointer, label in list(_references(changed)):
        href = reference.pop("href")
        known = fetches.get(href)
        fetch = Fetch(
            known.id if known else make_id(),
            href,
            (*(known.pointers if known else ()), pointer),
            known.label if known else label,
            (known.columns if known else "") or _text(reference.get("columns")),
        )
        fetches[href] = fetch
        reference["file"] = fetch.id
    return changed, tuple(fetches.values())


def require_allowed(fetches: tuple[Fetch, ...], sources: Sources) -> None:
    """Refuse files to come whose addresses are not allowed; nobody is asked yet.

    Raises
    ------
    InvalidRequestError
        With a pointer to every such address.
    """
    faults = []
    for fetch in fetches:
        try:
            sources.check(fetch.href)
        except AddressRefusedError as error:
            faults += [FieldFault(f"{pointer}/href", str(error)) for pointer in fetch.pointers]
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def without_absence(error: InvalidRequestError, fetches: tuple[Fetch, ...]) -> InvalidRequestError | None:
    """Give what is wrong besides that the files to come are not there yet; None when nothing is."""
    expected = {f"{pointer}/file" for fetch in fetches for pointer in fetch.pointers}
    faults = [fault for fault in error.faults if fault.pointer not in expected]
    return InvalidRequestError(str(error), faults) if faults or not error.faults else None


def pointed(error: ServiceError, fetches: tuple[Fetch, ...]) -> Problem:
    """Give the problem document of what went wrong with files, with pointers into the request as the client sent it."""
    if isinstance(error, InvalidRequestError):
        renamed = {f"{pointer}/file": f"{pointer}/href" for fetch in fetches for pointer in fetch.pointers}
        faults = [FieldFault(renamed.get(fault.pointer, fault.pointer), fault.detail) for fault in error.faults]
        return to_problem(InvalidRequestError(str(error), faults))
    return with_pointers(to_problem(error), fetches)


def with_pointers(problem: Problem, fetches: tuple[Fetch, ...]) -> Problem:
    """Say in a problem document which addresses of the request it is about."""
    detail = str(problem.get("detail") or problem["title"])
    places = [f"{pointer}/href" for fetch in fetches for pointer in fetch.pointers]
    return {**problem, "errors": [{"pointer": place, "detail": detail} for place in places]}


def _references(body: Any) -> Iterator[tuple[dict[str, Any], str, str]]:
    """Find the references by address: the object, the pointer to it, what it is."""
    inputs = _object(_object(body).get("inputs"))
    yield from _reference(inputs.get("photo"), ("photo",), "the photo")
    yield from _of_station(inputs.get("station"), ("station",), "the station")
    stations = inputs.get("stations")
    for number, station in enumerate(stations if isinstance(stations, list) else []):
        yield from _of_station(station, ("stations", number), f"station {number + 1}")


def _of_station(station: Any, where: tuple[str | int, ...], label: str) -> Iterator[tuple[dict[str, Any], str, str]]:
    name = _object(station).get("name")
    label = name if isinstance(name, str) else label
    yield from _reference(_object(station).get("scan"), (*where, "scan"), label)
    photos = _object(station).get("photos")
    for number, photo in enumerate(photos if isinstance(photos, list) else []):
        yield from _reference(photo, (*where, "photos", number), f"photo {number + 1} of {label}")


def _reference(found: Any, where: tuple[str | int, ...], label: str) -> Iterator[tuple[dict[str, Any], str, str]]:
    if isinstance(found, dict) and isinstance(found.get("href"), str) and "file" not in found:
        yield found, pointer_to("inputs", *where), label


def _text(found: Any) -> str:
    return found if isinstance(found, str) else ""


def _object(found: Any) -> dict[str, Any]:
    return found if isinstance(found, dict) else {}
