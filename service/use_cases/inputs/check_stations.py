"""Check what the schema of a request cannot know: names, files and scans that must exist."""

from collections.abc import Iterable, Sequence
from functools import partial

from algorithms.network.options import MOST_TIED
from algorithms.scans.content import ROUNDED_M, ScanContent, same_content
from schemas.requests.posed_stations import PosedInputs, PosedStation
from schemas.requests.register_inputs import RegisterInputs, ScanReference, Station
from schemas.values.crs import HEIGHTS_NEEDED
from service.errors import FieldFault, InvalidRequestError
from service.names.identifiers import is_identifier
from service.names.result_lists import comes_in_pages
from service.ports import FileStore, Json, StoredFile
from service.use_cases.documents.scan_warnings import is_usable
from service.use_cases.inputs.check_control import control_faults
from service.use_cases.inputs.check_photos import station_photo_faults
from service.use_cases.inputs.check_starts import start_faults
from service.use_cases.inputs.file_poses import file_pose_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

MOST_COMPARED = 100
"""Scans with as many points and nearly the same mean that one is compared with."""


def check_register_inputs(
    inputs: RegisterInputs, files: FileStore, max_stations: int, max_whole_stations: int = MOST_TIED
) -> None:
    """Check names, pairs, reference and files of a registration.

    Parameters
    ----------
    inputs
        Of the request.
    files
        Of its project.
    max_stations, max_whole_stations
        The settings: most stations of a job, and of one whose result is one document.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    """
    if len(inputs.stations) > max_stations:
        detail = f"{len(inputs.stations)} stations, the limit of this service is {max_stations}"
        raise InvalidRequestError(detail, [FieldFault("/inputs/stations", detail)])
    faults = [
        *_name_faults(inputs.stations),
        *_pair_faults(inputs),
        *_reference_faults(inputs),
        *start_faults(inputs),
        *control_faults(inputs),
        *_scanner_faults(inputs),
        *_tied_faults(inputs),
        *_method_faults(inputs),
        *_compared_faults(inputs, max_whole_stations),
        *_same_scan_faults(inputs.stations, files),
        *height_faults(inputs.stations, files),
        *(
            fault
            for number, station in enumerate(inputs.stations)
            for fault in _file_faults(station, files, pointer_to("inputs", "stations", number))
        ),
    ]
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def check_station(station: Station, files: FileStore) -> None:
    """Check the files of a single station.

    Raises
    ------
    InvalidRequestError
        With a pointer to every bad field.
    """
    faults = list(_file_faults(station, files, "/inputs/station"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def posed_station_faults(inputs: PosedInputs, files: FileStore, name: str = "stations") -> Iterable[FieldFault]:
    """Name what is wrong with names, files and poses of stations with poses; `name` is that of the input."""
    stations = getattr(inputs, name)
    if not isinstance(stations, list):  # those of a job are in its place by now
        return
    yield from station_faults(stations, files, name)
    if inputs.poses == "file":
        stated = [station.model_dump(mode="json", by_alias=True) for station in stations]
        yield from file_pose_faults(stated, partial(_scan_document, files), pointer_to("inputs", name))


def station_faults(stations: Sequence[Station | PosedStation], files: FileStore, name: str) -> Iterable[FieldFault]:
    """Name what is wrong with names and files of stations; `name` is that of the input."""
    yield from _name_faults(stations, name)
    for number, station in enumerate(stations):
        yield from _file_faults(station, files, pointer_to("inputs", name, number))


def height_faults(
    stations: Sequence[Station | PosedStation] | object, files: FileStore, name: str = "stations"
) -> Iterable[FieldFault]:
    """Name the scans whose z is no height, of stations that need one: levelled ones, and all of other processes."""
    for number, station in enumerate(stations if isinstance(stations, list) else ()):  # else those of a job
        is_free = station.levelled_std_gon is None if isinstance(station, Station) else station.world_from_scan
        found = None if is_free else _found_scan(station.scan, files)
        if found is not None and found[1].get("geocentric") and found[1].get("scan_pose") is None:
            why = f"{found[1]['geocentric']}: {HEIGHTS_NEEDED}"
            yield FieldFault(pointer_to("inputs", name, number, "scan"), why)


def _name_faults(stations: Sequence[Station | PosedStation], name: str = "stations") -> Iterable[FieldFault]:
    seen: set[str] = set()
    for number, station in enumerate(stations):
        if station.name in seen:
            yield FieldFault(pointer_to("inputs", name, number, "name"), f"the name '{station.name}' is used twice")
        seen.add(station.name)


def _pair_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    if inputs.pairs == "auto":
        return
    names = {station.name for station in inputs.stations}
    seen: set[frozenset[str]] = set()
    for number, pair in enumerate(inputs.pairs):
        where = pointer_to("inputs", "pairs", number)
        for side, name in enumerate(pair):
            if name not in names:
                yield FieldFault(f"{where}/{side}", f"there is no station '{name}'")
        if pair[0] == pair[1]:
            yield FieldFault(where, "a pair needs two different stations")
        elif frozenset(pair) in seen:
            yield FieldFault(where, "this pair is listed twice")
        seen.add(frozenset(pair))


def _reference_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    names = {station.name for station in inputs.stations}
    for name in inputs.reference or {}:
        if name not in names:
            yield FieldFault(pointer_to("inputs", "reference", name), f"there is no station '{name}'")


def _scanner_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    """Name what the search for errors of instruments lacks."""
    scanner = inputs.scanner
    if scanner is None:
        return
    if scanner.asks and len(inputs.stations) < 3:
        detail = "two stations do not tell errors of the instrument from those of their poses: give three or more"
        yield FieldFault(pointer_to("inputs", "scanner"), detail)
    if scanner.apply and not scanner.asks:
        detail = "nothing is estimated that could be applied: say what in `estimate` or `tripod`"
        yield FieldFault(pointer_to("inputs", "scanner", "apply"), detail)
    names = {station.name for station in inputs.stations}
    for instrument, stations in (scanner.instruments or {}).items():
        for number, name in enumerate(stations):
            if name not in names:
                where = pointer_to("inputs", "scanner", "instruments", instrument, number)
                yield FieldFault(where, f"there is no station '{name}'")


def _tied_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    """Name what can be adjusted with fewer stations only: it takes one dense covariance of all their poses."""
    if len(inputs.stations) <= MOST_TIED:
        return
    stated = any(station.targets for station in inputs.stations)
    asked = {
        "targets": inputs.targets is not None,
        "control": bool(inputs.control),
        "fix": inputs.fix != "first-station",
        "scanner": inputs.scanner is not None and inputs.scanner.asks,
        "stations": stated,
    }
    for name in (name for name, is_asked in asked.items() if is_asked):
        what = "`targets` of stations" if name == "stations" else f"`{name}`"
        detail = (
            f"{len(inputs.stations)} stations, with {what} at most {MOST_TIED}: leave it out, or register the parts of "
            "the site that have targets or control as jobs of their own"
        )
        yield FieldFault(pointer_to("inputs", name), detail)


def _method_faults(inputs: RegisterInputs) -> Iterable[FieldFault]:
    """Name compared methods that ask for other features: all share those of the job's own method."""
    shared = getattr(inputs.method, "features", None)
    for number, method in enumerate(inputs.compare_methods):
        if isinstance(method, str) or "features" not in method.model_fields_set:
            continue
        if getattr(method, "features", None) != shared:
            where = pointer_to("inputs", "compare_methods", number, "features")
            yield FieldFault(where, "all methods share the features of `method`: say there what counts as a feature")


def _compared_faults(inputs: RegisterInputs, max_whole_stations: int) -> Iterable[FieldFault]:
    """Refuse to compare methods on the thousands of pairs of a large network, whose figures stand in no document."""
    pairs = 0 if inputs.pairs == "auto" else len(inputs.pairs)
    if inputs.compare_methods and comes_in_pages(len(inputs.stations), pairs, max_whole_stations):
        detail = (
            f"{len(inputs.stations)} stations, methods are compared with at most {max_whole_stations} (and ten pairs "
            "for each): leave it out, or compare them on some of the stations"
        )
        yield FieldFault(pointer_to("inputs", "compare_methods"), detail)


def _same_scan_faults(stations: Sequence[Station], files: FileStore) -> Iterable[FieldFault]:
    """Name the stations whose scans are one and the same measurement: a scan laid on itself fits, and says nothing."""
    known = [(number, found) for number, station in enumerate(stations) if (found := _found_scan(station.scan, files))]
    for first, second in sorted({*_of_one_file(known), *_of_one_content(known)}):
        for here, other in ((first, second), (second, first)):
            yield FieldFault(
                pointer_to("inputs", "stations", here, "scan"),
                f"the scan is the same measurement as that of station '{stations[other].name}': a scan laid on itself "
                "says nothing",
            )


def _of_one_file(known: Sequence[tuple[int, tuple[str, Json]]]) -> Iterable[tuple[int, int]]:
    """Pair scans that are the same number in the same content with the first such one."""
    first: dict[tuple[str, int], int] = {}
    for number, (sha256, found) in known:
        before = first.setdefault((sha256, found["index"]), number)
        if before != number:
            yield before, number


def _of_one_content(known: Sequence[tuple[int, tuple[str, Json]]]) -> Iterable[tuple[int, int]]:
    """Pair each scan with the first one before it that has the same points.

    Sorted by the number of points and their mean, the same ones are neighbours: thousands are not compared with each
    other.
    """
    contents = sorted(
        (
            (ScanContent.from_json(found["content"]), number)
            for number, (_, found) in known
            if found.get("content") is not None  # files of earlier times are without
        ),
        key=lambda entry: (entry[0].points, entry[0].mean_m[0], entry[1]),
    )
    for place, (content, number) in enumerate(contents):
        for other, before in reversed(contents[max(0, place - MOST_COMPARED) : place]):
            if other.points != content.points or content.mean_m[0] - other.mean_m[0] > ROUNDED_M:
                break
            if same_content(other, content):
                yield min(before, number), max(before, number)
                break


def _found_scan(scan: ScanReference, files: FileStore) -> tuple[str, Json] | None:
    """Give the content of a scan's file and the document of the scan; None where there is none."""
    file = files.get(scan.file) if is_identifier(scan.file) else None
    if file is None:
        return None
    return next(((file.sha256, found) for found in file.scans if found["index"] == scan.index), None)


def _scan_document(files: FileStore, file_id: str, index: int) -> Json | None:
    """Return the document of a scan; None where there is none."""
    found = _found_scan(ScanReference(file=file_id, index=index), files)
    return None if found is None else found[1]


def _file_faults(station: Station | PosedStation, files: FileStore, where: str) -> Iterable[FieldFault]:
    yield from scan_faults(station.scan, files, f"{where}/scan")
    yield from station_photo_faults(station.photos, station.scan, files, f"{where}/photos")


def scan_faults(scan: ScanReference, files: FileStore, where: str) -> Iterable[FieldFault]:
    """Name what is wrong with a scan; `where` points to it."""
    file = files.get(scan.file) if is_identifier(scan.file) else None
    if file is None:
        yield FieldFault(f"{where}/file", f"there is no file '{scan.file}'; POST /files uploads one")
    elif not file.scans:
        yield FieldFault(f"{where}/file", f"the file '{file.name}' holds no scan")
    elif scan.index not in (numbers := [found["index"] for found in file.scans]):
        listed = ", ".join(map(str, numbers[:20])) + (", …" if len(numbers) > 20 else "")
        yield FieldFault(f"{where}/index", f"the file '{file.name}' holds {len(numbers)} scan(s), numbered {listed}")
    else:
        yield from _reading_faults(scan, file, file.scans[numbers.index(scan.index)], where)


def _reading_faults(scan: ScanReference, file: StoredFile, found: Json, where: str) -> Iterable[FieldFault]:
    """Look whether a scan can be read as the request says."""
    if not is_usable(found):
        yield FieldFault(f"{where}/index", f"scan {scan.index} of '{file.name}' cannot be used: {found.get('reason')}")
    declared = found.get("unit")
    if scan.unit is not None and declared is not None and scan.unit != declared:
        yield FieldFault(
            f"{where}/unit", f"the file '{file.name}' declares its coordinates in {declared}, not {scan.unit}"
        )
    if scan.unit is None and found.get("open_unit"):
        yield FieldFault(f"{where}/unit", f"'{file.name}': {found['open_unit']}")
    if scan.columns is not None and found.get("text_columns") is None:
        yield FieldFault(f"{where}/columns", f"the file '{file.name}' is no text table: its format says what is in it")
