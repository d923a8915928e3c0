"""Poses that E57 and PTX files state for their set-ups: which a job takes, and where they leave the frame open."""

from collections.abc import Callable, Iterator, Mapping, Sequence

from schemas.values.units import BY_NAME
from service.errors import FieldFault
from service.ports import Json

SAME_POSE = 1e-9
"""Largest difference from the identity [m, and entries of a rotation]; writers give it with ten digits and more."""
FROM_FILE, FROM_REQUEST, FROM_JOB, NOT_STATED = "file", "request", "job", "none"

Matrix = list[list[float]]
FindScan = Callable[[str, int], Json | None]
"""The document of a scan by identifier and number in the file; None: not known."""


def with_file_poses(stations: Sequence[Json], find: FindScan) -> list[Json]:
    """Return stations with the poses that their files state, where the request states none.

    Identity alone, in all files, tells nothing: every writer puts it there. Beside other poses it is that of the set-up
    whose frame is the common one.
    """
    poses = _stated(stations, find)
    if not any(pose is not None and not _is_identity(pose) for pose in poses):
        return list(stations)
    return [
        station if pose is None else {**station, "world_from_scan": {"matrix": pose, "covariance": None}}
        for station, pose in zip(stations, poses, strict=True)
    ]


def file_pose_faults(stations: Sequence[Json], find: FindScan, where: str) -> Iterator[FieldFault]:
    """Name the stations that have no pose beside others whose files state one.

    Parameters
    ----------
    stations
        As in a request.
    find
        Finds scans.
    where
        Pointer to the stations.
    """
    poses = _stated(stations, find)
    posed = [k for k, pose in enumerate(poses) if pose is not None and not _is_identity(pose)]
    if not posed:
        return
    at_identity = [k for k, pose in enumerate(poses) if pose is not None and _is_identity(pose)]
    reason = (
        f"its file states no pose, that of station '{stations[posed[0]]['name']}' states one: state `world_from_scan` "
        'of this station (the identity, where its coordinates are those of the world), or `"poses": "ignore"` for all'
    )
    for k, (station, pose) in enumerate(zip(stations, poses, strict=True)):
        if station.get("world_from_scan") is None and (pose is None or (k in at_identity and len(at_identity) > 1)):
            yield FieldFault(f"{where}/{k}/world_from_scan", reason)


def pose_source(stated: Json | None, used: Json | None) -> str:
    """Return where a pose is from: `file`, `request`, `job` or `none`.

    Parameters
    ----------
    stated
        The pose in the request.
    used
        The pose that the job takes.
    """
    if used is None:
        return NOT_STATED
    if stated is None:
        return FROM_FILE
    return FROM_JOB if "jobID" in stated else FROM_REQUEST


def scans_by_number(files: Mapping[str, Json]) -> FindScan:
    """Return a function that finds the scans of the files of a job."""

    def find(file: str, index: int) -> Json | None:
        scans = files.get(file, {}).get("scans", [])
        return next((scan for scan in scans if scan["index"] == index), None)

    return find


def _stated(stations: Sequence[Json], find: FindScan) -> list[Matrix | None]:
    """Return the pose that the file states for each station; None where it has none or the request states one."""
    are_open = [station.get("world_from_scan") is None for station in stations]
    return [_pose(each["scan"], find) if is_open else None for each, is_open in zip(stations, are_open, strict=True)]


def _pose(reference: Json, find: FindScan) -> Matrix | None:
    scan = find(reference["file"], reference.get("index", 0))
    if scan is None or scan.get("scan_pose") is None:
        return None
    # a file that declares no unit was described in its own numbers; the request says in which unit they are
    is_open = reference.get("unit") is not None and scan.get("unit") is None
    factor = BY_NAME[reference["unit"]].metres if is_open else 1.0
    *rows, last = scan["scan_pose"]
    return [*([*row[:3], factor * row[3]] for row in rows), last]


def _is_identity(pose: Matrix) -> bool:
    return all(abs(value - (i == j)) <= SAME_POSE for i, row in enumerate(pose) for j, value in enumerate(row))
