"""What `tieline register` sends: the inputs of a job, from options of the command line and from files."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas.requests.register_inputs import RegisterInputs
from service.errors import FieldFault, InvalidRequestError
from service.use_cases.inputs.read_photo_list import PhotoList, read_photo_list
from service.use_cases.inputs.validate_request import parse_json, validated

Document = dict[str, Any]
ANY_STATIONS = [{"name": name, "scan": {"file": name}} for name in "AB"]
"""In place of those that are known when the files are there."""


@dataclass(frozen=True)
class RequestOptions:
    """What was said on the command line of a registration."""

    photos: Path | None = None
    """JSON file with inputs of `register` whose stations name photos."""
    options: Path | None = None
    """JSON file with any inputs of `register`."""
    method: str | None = None
    compare_methods: str | None = None
    """Names of methods, separated by commas."""
    pairs: str | None = None
    """`auto`, or names of stations: ``A:B,A:C``, target first."""
    reference: Path | None = None
    """JSON file with known poses by name of the station."""
    control: Path | None = None
    """JSON file with a list of known points, as `control` of a request, or a text table of them."""
    targets: Path | None = None
    """JSON file with the targets of stations by their names."""
    find_targets: str | None = None
    """Kinds of targets and their sizes in metres, such as ``sphere:0.0725,board:0.3``."""
    crs: str | None = None
    control_axes: str | None = None
    fix: str | None = None
    levelled_std_gon: float | None = None
    point_std_m: float | None = None
    columns: str | None = None
    """What the columns of those scan files are that are text tables."""
    unit: str | None = None
    """Of the coordinates of all scans of which the files do not say it."""
    registered: Document | None = None
    """How the registered scans are wanted as files: the members of `outputs.registered`."""

    def outputs(self, others: Iterable[str]) -> Document | None:
        """Give the wanted outputs: who names one gets it alone, so that all `others` are named beside it."""
        if self.registered is None:
            return None
        return {**{name: {} for name in sorted(others)}, "registered": self.registered}

    def completed(self, station: Document) -> Document:
        """Add to a station what holds for every one of which the files do not say otherwise."""
        stated = {"levelled_std_gon": self.levelled_std_gon, "point_std_m": self.point_std_m}
        known = {name: value for name, value in stated.items() if value is not None}
        of_scan = {} if self.unit is None else {"unit": self.unit}
        return {**known, **station, "scan": {**of_scan, **station["scan"]}}


def read_request(said: RequestOptions, scans: Sequence[Path]) -> PhotoList:
    """Join what the files and the command line say of a job; the command line comes first, then the list of photos.

    Raises
    ------
    InvalidRequestError
        A file cannot be read, or what it or the command line says makes no sense, which is better known before scans
        are uploaded.
    """
    listed = [read_photo_list(path, scans) for path in (said.options, said.photos) if path is not None]
    inputs: Document = {}
    for each in listed:
        inputs.update(each.inputs)
    paths = list(dict.fromkeys(path for each in listed for path in each.paths))
    if said.method is not None:
        given = inputs.get("method")
        same = isinstance(given, dict) and given.get("method") == said.method
        inputs["method"] = given if same else {"method": said.method}
    if said.compare_methods is not None:
        inputs["compare_methods"] = [name.strip() for name in said.compare_methods.split(",") if name.strip()]
    if said.pairs is not None:
        inputs["pairs"] = parsed_pairs(said.pairs)
    if said.reference is not None:
        inputs["reference"] = object_in(said.reference)
    if said.control is not None:
        is_json = said.control.suffix.lower() == ".json"
        inputs["control"] = list_in(said.control) if is_json else table_in(said.control)
    if said.targets is not None:
        inputs["stations"] = with_targets(inputs.get("stations"), object_in(said.targets))
    if said.find_targets is not None:
        inputs["targets"] = {"kinds": parsed_kinds(said.find_targets)}
    given = {"crs": said.crs, "control_axes": said.control_axes, "fix": said.fix}
    inputs.update({name: value for name, value in given.items() if value is not None})
    try:
        validated(RegisterInputs, {**inputs, "stations": [said.completed(station) for station in ANY_STATIONS]})
    except InvalidRequestError as error:
        raise InvalidRequestError("some options make no sense", error.faults) from None
    return PhotoList(inputs, paths)


def parsed_pairs(text: str) -> str | list[list[str]]:
    """Read names of stations as on the command line.

    Raises
    ------
    InvalidRequestError
        These are no pairs.
    """
    if text.strip() == "auto":
        return "auto"
    pairs = [[name.strip() for name in pair.split(":")] for pair in text.split(",")]
    if any(len(pair) != 2 or not all(pair) for pair in pairs):
        fault = FieldFault("/pairs", "`auto`, or pairs of stations as target:source, separated by commas: A:B,A:C")
        raise InvalidRequestError(f"'{text}' names no pairs", [fault])
    return pairs


def parsed_kinds(text: str) -> list[Document]:
    """Read kinds of targets with their sizes as on the command line.

    Raises
    ------
    InvalidRequestError
        These are none.
    """
    kinds: list[Document] = []
    for each in text.split(","):
        kind, _, size = each.strip().partition(":")
        try:
            kinds.append({"kind": kind, "radius_m" if kind == "sphere" else "size_m": float(size)})
        except ValueError:
            fault = FieldFault("/targets/kinds", "kinds with their sizes in metres, such as sphere:0.0725,board:0.3")
            raise InvalidRequestError(f"'{each}' names no kind of targets", [fault]) from None
    return kinds


def with_targets(stations: Any, targets: Document) -> list[Document]:
    """Add targets to the stations of their names."""
    listed = [dict(station) for station in stations] if isinstance(stations, list) else []
    known = {station.get("name") for station in listed}
    listed += [{"name": name} for name in targets if name not in known]
    return [{**each, "targets": targets[each["name"]]} if each.get("name") in targets else each for each in listed]


def list_in(path: Path) -> list[Any]:
    """Read a JSON file that holds a list.

    Raises
    ------
    InvalidRequestError
        It cannot be read, or holds something else.
    """
    found = _document_in(path)
    if not isinstance(found, list):
        raise InvalidRequestError(f"{path}: a list is expected, {json.dumps(found)[:40]} was found")
    return found


def object_in(path: Path) -> Document:
    """Read a JSON file that holds an object.

    Raises
    ------
    InvalidRequestError
        It cannot be read, or holds something else.
    """
    document = _document_in(path)
    if not isinstance(document, dict):
        raise InvalidRequestError(f"{path}: an object is expected, {json.dumps(document)[:40]} was found")
    return document


def _document_in(path: Path) -> Any:
    try:
        return parse_json(path.read_bytes())
    except OSError as error:
        raise InvalidRequestError(f"{path} cannot be read: {error.strerror}") from None
    except InvalidRequestError as error:
        raise InvalidRequestError(f"{path}: {error}") from None


def document_in(path: Path) -> Document:
    """Read a document that is an input of its own: a JSON file that holds an object, or a network of another program.

    Raises
    ------
    InvalidRequestError
        It cannot be read, or holds something else.
    """
    text = _text_in(path)
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        return object_in(path)
    return {"format": "gama-local" if "<gama-local" in text else "riscan-project", "xml": text}


def table_in(path: Path) -> Document:
    """Read a text table of points, in place of their list."""
    return {"csv": _text_in(path)}


def _text_in(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InvalidRequestError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InvalidRequestError(f"{path} is no text in UTF-8") from None
