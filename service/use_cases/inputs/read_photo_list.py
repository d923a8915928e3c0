"""Read from a JSON file which photos belong to which station."""

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.errors import FieldFault, InvalidRequestError
from service.ports import Json
from service.use_cases.inputs.validate_request import parse_json, pointer_to


@dataclass(frozen=True)
class PhotoList:
    """Inputs of `register` that name files as they lie on the disk, and the photos among these files."""

    inputs: Json
    paths: Sequence[Path]
    """Every photo once."""

    def stations(self, identifiers: Mapping[Path, str]) -> Any:
        """Give the listed stations with identifiers for the photos that were uploaded."""
        stations = deepcopy(self.inputs.get("stations"))
        for photo, _ in _photos_of(stations):
            path = Path(photo["file"])
            photo["file"] = identifiers.get(path, path.name)
        return stations


def read_photo_list(path: Path, scans: Sequence[Path]) -> PhotoList:
    """Read a list of photos; the paths in it start at its own folder.

    Parameters
    ----------
    path
        JSON file with inputs of `register`; of these `stations` may leave out what `stations_of_uploads` fills in.
    scans
        Files of the scans. Images in them are named like photos.

    Raises
    ------
    InvalidRequestError
        It cannot be read, is no JSON object, or names a photo that is not there.
    """
    try:
        document = parse_json(path.read_bytes())
    except OSError as error:
        raise InvalidRequestError(f"{path} cannot be read: {error.strerror}") from None
    except InvalidRequestError as error:
        raise InvalidRequestError(f"{path}: {error}") from None
    inputs = document["inputs"] if isinstance(document, dict) and document.keys() == {"inputs"} else document
    if not isinstance(inputs, dict):
        raise InvalidRequestError(f"{path}: an object with the member `stations` is expected")
    found: dict[Path, None] = {}
    faults = []
    for photo, where in _photos_of(inputs.get("stations")):
        given = path.parent / photo["file"]
        photo["file"] = str(given)
        if given.is_file():
            found[given] = None
        elif given.name not in {scan.name for scan in scans}:
            faults.append(FieldFault(f"{where}/file", f"there is no file {given}"))
    if faults:
        raise InvalidRequestError(f"{path} names photos that are not there", faults)
    return PhotoList(inputs, list(found))


def _photos_of(stations: Any) -> Iterator[tuple[Json, str]]:
    """Yield the photos that name a file, and pointers to them."""
    for k, station in enumerate(stations if isinstance(stations, list) else ()):
        photos = station.get("photos") if isinstance(station, dict) else None
        for j, photo in enumerate(photos if isinstance(photos, list) else ()):
            if isinstance(photo, dict) and isinstance(photo.get("file"), str):
                yield photo, pointer_to("stations", k, "photos", j)
