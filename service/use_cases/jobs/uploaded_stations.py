"""Which scans and photos of one upload make which station.

The stations are listed as in the inputs of `register`, but name files as they were uploaded instead of by identifier,
and may leave out what the upload itself tells: names, scans in their order, photos that lie in the file of a scan.
"""

import re
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any, TypeAlias

from schemas.requests.register_inputs import MAX_PHOTOS
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json
from service.use_cases.documents.scan_warnings import is_usable
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

ADVICE = (
    "list it among the `photos` of the station from which it was taken, with its camera and scan_from_camera (or mount "
    "and cop)"
)
Place: TypeAlias = tuple[str, int]
"""Identifier of a file and number of the scan in it."""


@dataclass(frozen=True)
class UploadedFile:
    """What is known of a stored file."""

    id: str
    name: str
    scans: Sequence[Json]
    photos: Sequence[Json]


def numbered_name(number: int) -> str:
    """Give the name that stands for a scan by its number in the upload, from 0: S1 is the first."""
    return f"S{number + 1}"


def names_of_scans(files: Sequence[UploadedFile]) -> list[str]:
    """Name every usable scan after its file, with its number where the file holds several; no name occurs twice.

    Parameters
    ----------
    files
        In the order of the upload.
    """
    names: list[str] = []
    taken: set[str] = set()
    for file in files:
        for scan in filter(is_usable, file.scans):
            stem = _station_name(PurePosixPath(file.name).stem)
            wanted = stem if len(file.scans) == 1 else f"{stem}-{scan['index'] + 1}"
            name, number = wanted, 2
            while name in taken:
                name, number = f"{wanted} ({number})", number + 1
            taken.add(name)
            names.append(name)
    return names


def _station_name(text: str) -> str:
    """Replace what a station's name may not hold: so it can stand in tables, pages and names of files."""
    cleaned = re.sub(r"[^\w .()+-]", "_", text)[:48]
    return cleaned if re.match(r"\w", cleaned) else f"scan{cleaned}"


def stations_of_uploads(
    listed: Any, scan_files: Sequence[UploadedFile], photo_files: Sequence[UploadedFile], names: Sequence[str]
) -> list[Json]:
    """Give the stations of `register`: those listed, then one of every scan that none of them takes.

    A listed station without `scan` has the scan after which it is named (`names`), or the next that none names; a photo
    without `file` is the next that none names. A station without `photos` has those that the file of its scan stores
    with camera and pose; an empty list leaves them out. Whatever else is wrong with a station is left for the
    validation of the request.

    Parameters
    ----------
    listed
        The stations as the client wrote them, parsed JSON; None if it wrote none.
    scan_files, photo_files
        What was uploaded as scans and as photos, in the order of the upload.
    names
        Name of each scan's station where the list gives none.

    Raises
    ------
    InvalidRequestError
        A file is of the wrong kind, a name fits none or several, or a photo belongs to no station; pointers begin with
        ``/stations``, ``/scan`` or ``/photo``.
    """
    if listed is not None and not (isinstance(listed, list) and listed and all(isinstance(s, dict) for s in listed)):
        detail = "a list of objects, one per station; leave it out where every scan is a station without further photos"
        raise InvalidRequestError(detail, [FieldFault("/stations", detail)])
    stations: list[Json] = deepcopy(listed or [])
    search = _Search(scan_files, photo_files)
    search.refuse_strangers()
    search.place_scans(stations, names)
    search.place_photos(stations)
    if search.faults:
        raise InvalidRequestError(WRONG_FIELDS, search.faults)
    return stations


@dataclass
class _Search:
    """The uploaded files, and what could not be found among them."""

    scan_files: Sequence[UploadedFile]
    photo_files: Sequence[UploadedFile]
    faults: list[FieldFault] = field(default_factory=list)

    def refuse_strangers(self) -> None:
        """Refuse photos that came as scans and the other way round."""
        for file in self.scan_files:
            if not file.scans:
                self._fault("/scan", f"the file '{file.name}' holds no scan; photos are sent in the field `photo`")
        for file in self.photo_files:
            if not file.photos:
                self._fault("/photo", f"the file '{file.name}' holds no photo; scans are sent in the field `scan`")

    def place_scans(self, stations: list[Json], names: Sequence[str]) -> None:
        """Give every station its scan, every scan its station, and stations of which nothing is said their photos."""
        files = {(file.id, scan["index"]): file for file in self.scan_files for scan in file.scans if is_usable(scan)}
        defaults = dict(zip(files, names, strict=True))
        given = [self._place_of(station.get("scan"), pointer_to("stations", k)) for k, station in enumerate(stations)]
        # the number of a scan in the upload is a name too, while no file is called so
        by_number = {numbered_name(k): place for k, place in enumerate(files) if place not in given}
        by_name = by_number | {name: place for place, name in defaults.items() if place not in given}
        for k, station in enumerate(stations):
            if given[k] is None and _names_no_scan(station) and isinstance(station.get("name"), str):
                given[k] = by_name.get(station["name"])
                by_name = {name: place for name, place in by_name.items() if place != given[k]}
        free = [place for place in files if place not in given]
        for k, station in enumerate(stations):
            if given[k] is None and _names_no_scan(station):
                given[k] = free.pop(0) if free else None
                if given[k] is None:
                    self._fault(pointer_to("stations", k), f"there is no scan left for it, only {len(files)} came")
            elif given[k] is not None and given[k] in given[:k]:
                self._fault(pointer_to("stations", k, "scan"), "this scan has a station already")
        stations += [{} for _ in free]
        for k, (station, place) in enumerate(zip(stations, [*given, *free], strict=True)):
            if place is None:
                station.setdefault("name", f"station {k + 1}")  # refused for its scan, not for its name
            else:
                scan = station.get("scan") or {}
                station["scan"] = {**scan, "file": place[0], "index": place[1]}
                station.setdefault("name", defaults.get(place, f"station {k + 1}"))
                station.setdefault("photos", _stored_photos(files.get(place), place[1]))

    def place_photos(self, stations: Sequence[Json]) -> None:
        """Put identifiers in the place of the names of photos."""
        photos = [
            (photo, pointer_to("stations", k, "photos", j))
            for k, station in enumerate(stations)
            if isinstance(station.get("photos"), list)
            for j, photo in enumerate(station["photos"])
            if isinstance(photo, dict)
        ]
        of_scans = [file for file in self.scan_files if file.photos]
        named = [(photo, where) for photo, where in photos if photo.get("file") is not None]
        for photo, where in named:
            file = self._named(photo["file"], [self.photo_files, of_scans], f"{where}/file")
            photo["file"] = photo["file"] if file is None else file.id
        taken = {photo["file"] for photo, _ in named if isinstance(photo["file"], str)}
        free = [file for file in self.photo_files if file.id not in taken]
        for photo, where in photos:
            if photo.get("file") is None and free:
                photo["file"] = free.pop(0).id
            elif photo.get("file") is None:
                self._fault(where, f"there is no photo left for it, only {len(self.photo_files)} came")
        for file in [] if self.faults else free:  # a wrong name leaves its photo over
            self._fault("/photo", f"the photo '{file.name}' belongs to no station: {ADVICE}")

    def _place_of(self, scan: Any, where: str) -> Place | None:
        """Find the scan that a station names; None if it names none, or in a way that no schema allows."""
        if not isinstance(scan, dict) or not isinstance(scan.get("index", 0), int) or _names_no_scan({"scan": scan}):
            return None
        if scan.get("file") is None and len(self.scan_files) == 1:
            return self.scan_files[0].id, scan.get("index", 0)
        file = self._named(scan.get("file"), [self.scan_files], f"{where}/scan/file")
        return None if file is None else (file.id, scan.get("index", 0))

    def _named(self, name: Any, where_to_look: Sequence[Sequence[UploadedFile]], where: str) -> UploadedFile | None:
        """Find the file of a name, or of an identifier, in the first group that has one."""
        last = PurePosixPath(name).name if isinstance(name, str) else None
        for files in where_to_look:
            found = [file for file in files if name == file.id] or [file for file in files if last == file.name]
            if len(found) > 1:
                self._fault(where, f"{len(found)} files are called '{last}'; leave `file` out to take them in order")
            if found:
                return found[0]
        sent = ", ".join(f"'{file.name}'" for files in where_to_look for file in files) or "none"
        self._fault(where, f"no file '{name}' came with this request; there are: {sent}")
        return None

    def _fault(self, where: str, detail: str) -> None:
        self.faults.append(FieldFault(where, detail))


def _names_no_scan(station: Json) -> bool:
    """Tell whether a station has the next scan; what is said of that may stand in it, such as its unit."""
    scan = station.get("scan")
    return scan is None or (isinstance(scan, dict) and bool(scan) and scan.keys() <= {"unit", "columns"})


def _stored_photos(file: UploadedFile | None, index: int) -> list[Json]:
    """List the photos that a file stores with camera and pose in the frame of one of its scans.

    None if there are more than a station may have: that many were taken on the way, not from the scanner's station.
    """
    photos = (
        [
            {"file": file.id, "index": photo["index"]}
            for photo in file.photos
            if not photo.get("refused")
            and photo.get("scan") == index
            and photo.get("camera") is not None
            and photo.get("scan_from_camera") is not None
        ]
        if file
        else []
    )
    return photos if len(photos) <= MAX_PHOTOS else []
