"""What `tieline register` sends: the inputs of a job, from options of the command line and from files."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas.register_inputs import RegisterInputs
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


def object_in(path: Path) -> Document:
    """Read a JSON file that holds an object.

    Raises
    ------
    InvalidRequestError
        It cannot be read, or holds something else.
    """
    try:
        document = parse_json(path.read_bytes())
    except OSError as error:
        raise InvalidRequestError(f"{path} cannot be read: {error.strerror}") from None
    except InvalidRequestError as error:
        raise InvalidRequestError(f"{path}: {error}") from None
    if not isinstance(document, dict):
        raise InvalidRequestError(f"{path}: an object is expected, {json.dumps(document)[:40]} was found")
    return document
