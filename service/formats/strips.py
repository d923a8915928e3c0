"""Strips of airborne scans: points and times from LAS and LAZ, trajectories from text, corrected strips to LAZ."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int8, Int32

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError
from algorithms.strips.strip import Trajectory
from schemas.values.units import unit_named, unit_words
from service.errors import UnwritableError
from service.formats.base import ReadLimits, ScanFile
from service.formats.finishing import none_left
from service.formats.las import OpenedLas
from service.formats.las_units import projection_behind_points
from service.formats.number_table import read_table, refuse_long_lines
from service.formats.point_selection import left_out_in_words
from service.formats.text_layout import HEAD_BYTES, LayoutError, layout_of
from service.formats.writers.whole_files import whole_file

TRAJECTORY_COLUMNS = ("time", "x", "y", "z")
ANGLE_COLUMNS = ("roll", "pitch", "heading")
NAMES = {
    **dict.fromkeys(("time", "t", "gps_time", "gpstime", "sow", "tow", "seconds"), "time"),
    **dict.fromkeys(("x", "easting", "east", "e"), "x"),
    **dict.fromkeys(("y", "northing", "north", "n"), "y"),
    **dict.fromkeys(("z", "height", "h", "elevation", "altitude"), "z"),
    **dict.fromkeys(("roll", "r"), "roll"),
    **dict.fromkeys(("pitch", "p"), "pitch"),
    **dict.fromkeys(("heading", "yaw", "hdg", "azimuth"), "heading"),
}
"""What columns of trajectories are called, and what they hold."""
RADIANS = {"deg": np.pi / 180.0, "gon": np.pi / 200.0, "rad": 1.0}
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3}
UNIT_BEHIND = re.compile(r"[\[(].*|_(mm|cm|m|ft|feet|us-ft|usft)$")
MOST_PLACES = 20_000_000
LARGEST_STEP = 2**31 - 1
COPC = "copc"
"""User of the records that say how points are arranged in an octree, which written strips are not."""


@dataclass(frozen=True, eq=False)
class StripRecords:
    """The points of a file in the order of their times."""

    points: Points
    """(n, 3) minus `base_m` [m]."""
    base_m: Vector3
    gps_time_s: Scalars
    """(n,) as in the file."""
    directions: Int8[Array, "n"] | None
    """(n,) 1 and 0 for the two directions of the mirror; None where the file tells one only."""
    order: Array | None
    """(n,) number among the used points of the file of each point; None: the file has that order."""
    point_sources: Array
    """(n,) flight line that each point names."""
    left_out: str = ""
    """Points that the file marks as not to be used, in words; empty: none."""


def read_strip(path: Path, filename: str, limits: ReadLimits) -> StripRecords:
    """Read a LAS or LAZ file with the GPS time of every point that is neither withheld nor noise.

    Raises
    ------
    UnreadableFileError
        The file is damaged, or no LAS, or has no times.
    """
    file = ScanFile(path, filename)
    opened = OpenedLas(file, limits)
    raw, times, senses, sources = [], [], [], []
    left_out: Counter[str] = Counter()
    for chunk in opened.chunks():
        names = set(chunk.point_format.dimension_names)
        if "gps_time" not in names:
            raise file.unreadable(f"point format {chunk.point_format.id} has no GPS time", "header")
        chosen = file.selection.chosen(chunk, left_out)
        used = slice(None) if chosen is None else chosen
        raw.append(np.column_stack([np.asarray(chunk[axis])[used] for axis in "XYZ"]))
        times.append(np.asarray(chunk["gps_time"], dtype=np.float64)[used])
        senses.append(np.asarray(chunk["scan_direction_flag"], dtype=np.int8)[used])
        sources.append(np.asarray(chunk["point_source_id"], dtype=np.int32)[used])
    if not sum(map(len, raw)):
        raise file.unreadable(none_left(left_out) if left_out else "the file holds no points", "header")
    time, sense = np.concatenate(times), np.concatenate(senses)
    if not np.isfinite(time).all():
        raise file.unreadable("a GPS time is no number", f"point {int(np.flatnonzero(~np.isfinite(time))[0])}")
    points, source = np.concatenate(raw) * opened.scales, np.concatenate(sources)
    order = None
    if (np.diff(time) < 0.0).any():
        order = np.argsort(time, kind="stable")
        points, time, sense, source = points[order], time[order], sense[order], source[order]
    directions = sense if sense.min() != sense.max() else None
    return StripRecords(points, opened.offsets, time, directions, order, source, left_out_in_words(left_out))


def write_corrected(
    source: ScanFile,
    limits: ReadLimits,
    target: Path,
    moved: Callable[[Float64[Array, "n 3"], Scalars, Int32[Array, "n"]], Points],
) -> int:
    """Write a strip again as LAZ with other coordinates and all else as it was, in its own order; give the points.

    Parameters
    ----------
    source, limits
        The file, and how much it may ask for.
    target
        Where to write.
    moved
        Gives corrected from full coordinates (n, 3) [m], times (n,) and point sources (n,).

    Raises
    ------
    UnwritableError
        A corrected coordinate is beyond what the file's steps reach.
    """
    import laspy

    opened, count, writer = OpenedLas(source, limits), 0, None
    with whole_file(target) as partial, partial.open("wb") as stream:
        try:
            for chunk in opened.chunks():
                if writer is None:
                    header = opened.header
                    header.vlrs = [record for record in header.vlrs if record.user_id != COPC]
                    known = {record.record_id for record in header.vlrs}
                    behind = projection_behind_points(source)
                    header.vlrs += [laspy.VLR(*record) for record in behind if record[1] not in known]
                    header.generating_software = "tieline"
                    writer = laspy.LasWriter(stream, header, do_compress=True, closefd=False)
                raw = np.column_stack([np.asarray(chunk[axis]) for axis in "XYZ"])
                sources = np.asarray(chunk["point_source_id"], dtype=np.int32)
                corrected = moved(raw * opened.scales + opened.offsets, np.asarray(chunk["gps_time"]), sources)
                steps = np.rint((corrected - opened.offsets) / opened.scales)
                if np.abs(steps).max() > LARGEST_STEP:
                    raise UnwritableError(source.filename, "corrected coordinates lie beyond the reach of its steps")
                _put(chunk, steps.astype(np.int32))
                writer.write_points(chunk)
                count += len(chunk)
        finally:
            if writer is not None:
                writer.close()
    return count


def _put(chunk: Any, steps: Array) -> None:
    for k, axis in enumerate("XYZ"):
        chunk[axis] = steps[:, k]


def _factors(file: ScanFile, columns: Mapping[str, str], angle_unit: str) -> dict[str, float]:
    """Return what turns the numbers of each column into seconds, metres and radians, as its name says.

    Raises
    ------
    UnreadableFileError
        A name says a unit that is none known here.
    """
    found = dict.fromkeys(ANGLE_COLUMNS, RADIANS[angle_unit])
    for role, name in columns.items():
        words = unit_words(name)
        if not words or role == "-":
            continue
        of_length = unit_named(words)
        known = SECONDS.get(words) if role == "time" else RADIANS.get(words) if role in ANGLE_COLUMNS else None
        if role in {"x", "y", "z"} and of_length is not None:
            known = of_length.metres
        if known is None:
            raise file.unreadable(f"the unit {words!r} of the column {name!r} is not known", "line 1")
        found[role] = known
    for axis in ("y", "z"):
        found.setdefault(axis, found.get("x", 1.0))
    return found


def read_trajectory(
    path: Path, filename: str, columns: Sequence[str] | None, angle_unit: str, origin_m: Vector3, origin_s: float
) -> Trajectory:
    """Read where the scanner was: time, x, y, z, and with them roll, pitch and heading, or not.

    Parameters
    ----------
    path, filename
        The file, and what its owner calls it.
    columns
        What its columns hold; None: as the first line names them, else time, x, y, z and, of seven, the angles.
    angle_unit
        deg, gon or rad.
    origin_m, origin_s
        What is subtracted.

    Raises
    ------
    UnreadableFileError
        It is no such table, with the line.
    """
    file = ScanFile(path, filename)
    refuse_long_lines(file)
    with path.open("rb") as binary:
        head = binary.read(HEAD_BYTES)
    try:
        layout = layout_of(head)
    except LayoutError as fault:
        raise file.unreadable(str(fault), f"line {fault.line}") from fault
    named = [name.lower() for name in columns] if columns else [name.strip("\"' ").lower() for name in layout.names]
    roles = [NAMES.get(UNIT_BEHIND.sub("", name).strip(), "-") for name in named]
    factors = _factors(file, dict(zip(roles, named, strict=True)), angle_unit)
    if not roles:
        every = (*TRAJECTORY_COLUMNS, *ANGLE_COLUMNS)
        if layout.width not in {len(TRAJECTORY_COLUMNS), len(every)}:
            raise file.unreadable(
                f"{layout.width} columns without names: name them in the first line, or say `columns`", "line 1"
            )
        roles = list(every[: layout.width])
    missing = [name for name in TRAJECTORY_COLUMNS if roles.count(name) != 1]
    angles = [name for name in ANGLE_COLUMNS if name in roles]
    if missing or len(angles) not in {0, 3}:
        what = ", ".join(missing) if missing else ", ".join(name for name in ANGLE_COLUMNS if name not in roles)
        raise file.unreadable(f"no single column holds {what}; columns are {', '.join(named or roles)}", "line 1")
    chosen = [roles.index(name) for name in (*TRAJECTORY_COLUMNS, *angles)]
    with path.open(encoding=layout.encoding) as stream:
        for _ in range(layout.skipped_lines):
            stream.readline()
        lines = islice(stream, MOST_PLACES)
        if layout.separators.decimal_comma:
            lines = (line.replace(",", ".") for line in lines)  # type: ignore[assignment]
        table = read_table(
            file, lines, layout.skipped_lines + 1, delimiter=layout.separators.delimiter,
            columns=chosen, comment="#",
        )  # fmt: skip
    if not np.isfinite(table).all():
        line = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0]) + layout.skipped_lines + 1
        raise file.unreadable("a value is no finite number", f"line {line}")
    table = table * [factors.get(name, 1.0) for name in (*TRAJECTORY_COLUMNS, *angles)]
    turned = table[:, 4:] if angles else None
    if turned is not None:
        turned = np.unwrap(turned, axis=0)
    try:
        return Trajectory(table[:, 0] - origin_s, table[:, 1:4] - origin_m, turned)
    except InvalidInputError as fault:
        raise file.unreadable(fault.why) from fault
