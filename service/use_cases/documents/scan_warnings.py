"""What is to be said of the scans of a file, wherever they are used."""

from collections.abc import Sequence

from service.ports import Json, StoredFile

TAKEN_FOR_METRES = "the coordinates are taken for metres"
"""So warnings begin that hold only while nobody states a unit (`algorithms.scans.scale_plausibility`)."""


def is_usable(scan: Json) -> bool:
    """Tell whether a job may use a scan; what was stored before this was asked is usable."""
    return bool(scan.get("usable", True))


def left_out(filename: str, scans: Sequence[Json]) -> list[str]:
    """Say which scans of a file cannot be used."""
    return [f"{filename}: {_called(scan)} was left out: {scan.get('reason')}" for scan in scans if not is_usable(scan)]


def file_warnings(file: StoredFile) -> list[str]:
    """Give the warnings of all scans of a file; where it has several, each names its scan."""
    several = len(file.scans) > 1
    found = [
        f"{_called(scan)}: {warning}" if several else str(warning)
        for scan in file.scans
        for warning in scan.get("warnings") or ()
    ]
    return [
        *found,
        *(f"{_called(scan)} cannot be used: {scan.get('reason')}" for scan in file.scans if not is_usable(scan)),
    ]


def warnings_of_scan(filename: str, scans: Sequence[Json], index: int, unit: str | None) -> list[str]:
    """Give what a job says of a scan that it uses: its warnings, a stated unit, and its neighbours that were left out.

    Parameters
    ----------
    filename
        Of its file.
    scans
        Of the file, as it was inspected.
    index
        Number of the scan.
    unit
        That the request states; None: it does not.
    """
    said = [str(text) for scan in scans if scan["index"] == index for text in scan.get("warnings") or ()]
    own = [f"{filename}: {text}" for text in said if unit is None or not text.startswith(TAKEN_FOR_METRES)]
    if unit not in {None, "m"}:
        own.append(f"{filename}: the coordinates were converted from {unit} to metres, as the request states")
    return [*own, *left_out(filename, scans)]


def _called(scan: Json) -> str:
    return f"scan {scan['index']}" + (f" '{scan['name']}'" if scan.get("name") else "")
