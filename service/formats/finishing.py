"""From the records of any format to a `Scan`: what every reader must promise is checked once, here."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Colors, Flags, Floats32, Points, Vector3
from algorithms.scans.content_sums import content_of
from algorithms.scans.scale_plausibility import scan_warnings
from algorithms.scans.scan import Scan, ScanGrid
from schemas.values.units import BY_NAME, METRE
from service.errors import FileTooLargeError
from service.formats.base import ReadLimits, RefusedScan, ScanFile, ScanInfo, ScanRecords
from service.formats.geocentric import geocentric_in_words
from service.formats.intensities import in_unsigned_range, limits_of, range_in_words, signed_range
from service.formats.point_selection import left_out_in_words, unselected_in_words
from service.formats.units import DeclaredUnit

LARGEST_COORDINATE_M = 1e8
NEAR_M = 1_000.0
"""Centres nearer than this keep the file's own origin."""
LONGEST_RANGE_M = 10_000.0
"""No terrestrial scanner measures farther: a nearest point beyond it shows that the file's origin is no instrument."""
UNMARK = (
    "take the marks off good points (such as with `pdal translate in.laz out.laz assign "
    '--filters.assign.value="Withheld = 0"`, or with `"Classification = 1"` for noise) and send the file again; or '
    "choose other points, where the request chose them"
)
"""What can be done where no point is left."""
FREE_POINTS, MOST_POINTS_PER_BYTE = 1_000_000, 2
"""However well they are packed, measured points need more than half a byte each; few may be packed as they like."""
SPARSEST_GRID = 1 / 50
"""A grid with fewer points per cell tells no neighbourhoods and costs memory."""


def finish(file: ScanFile, records: ScanRecords) -> Scan:
    """Check the records of one scan and bring them into the reduced scan frame.

    Records without a return or with a coordinate that is not finite are dropped, and the grid is renumbered.
    Coordinates in another unit than metres, which the file or its owner names, are converted.

    Raises
    ------
    UnreadableFileError
        No usable point, fewer than four distinct points, no extent, or a coordinate beyond 1e8 m; or the owner states
        another unit than the file.
    """
    place = f"scan {records.index}"
    records = in_metres(file, records, place)
    points = records.points
    if len(points) == 0:
        raise file.unreadable("the scan holds no points", place)
    keep = finite(points)
    if not keep.any():
        raise file.unreadable("no point of the scan has finite coordinates", place)
    if records.valid is not None:
        keep &= records.valid
        if not keep.any():
            raise file.unreadable(none_left(records.left_out), place)
    if keep.all():
        chosen: Flags | slice = slice(None)
    else:
        chosen = keep
        points = points[keep]
    base_m = np.zeros(3) if records.base_m is None else records.base_m
    intensity = None if records.intensity is None else records.intensity[chosen]
    limits = limits_of(intensity)
    low_m, high_m = bounds_of(points)
    _refuse_absurd(file, place, points, low_m, high_m, base_m, keep)
    origin_m = local_origin(low_m + base_m, high_m + base_m)
    shift_m = base_m - origin_m
    if shift_m.any():
        points += shift_m
        low_m, high_m = low_m + shift_m, high_m + shift_m
    return Scan(
        points=np.ascontiguousarray(points, dtype=np.float64),
        origin_m=origin_m,
        name=records.name,
        grid=_grid(records, keep),
        intensity=in_unsigned_range(intensity, signed_range(limits)),
        intensity_scale=records.intensity_scale,
        color=None if records.color is None else records.color[chosen],
        times_s=None if records.times_s is None else records.times_s[chosen],
        sensor_m=_sensor(records, low_m, high_m, origin_m),
        world_from_scan=records.world_from_scan,
        attributes={each: values[chosen] for each, values in records.attributes.items()},
        crs_wkt=records.crs_wkt,
        unit_before="" if (unit := converted_unit(file, records)) is None else unit.name,
        notes=(*reading_notes(file, records), *range_in_words(limits)),
    )


def reading_notes(file: ScanFile, records: ScanRecords) -> tuple[str, ...]:
    """Say which points were left out, and what of them was not read."""
    # formats that tell classes and returns tell point sources
    unmarked = unselected_in_words(file.selection) if records.point_sources is None else ""
    unit = converted_unit(file, records)
    converted = "" if unit is None else conversion(unit)
    return tuple(said for said in (converted, left_out_in_words(records.left_out), unmarked, *records.lost) if said)


def scan_info(index: int, scan: Scan, dropped: int) -> ScanInfo:
    """Describe a scan for its file document."""
    return ScanInfo(
        index=index,
        name=scan.name,
        points=len(scan),
        dropped=dropped,
        structured=scan.grid is not None,
        rows=None if scan.grid is None else scan.grid.rows,
        columns=None if scan.grid is None else scan.grid.columns,
        bounds_m=np.stack(bounds_of(scan.points)) + scan.origin_m,
        has_intensity=scan.intensity is not None,
        has_color=scan.color is not None,
        scan_pose=None if scan.world_from_scan is None else scan.world_from_scan.as_matrix(),
        warnings=scan_warnings(scan),
        content=content_of(scan.points, scan.origin_m),
        geocentric=geocentric_in_words(scan.crs_wkt, scan.bounds_m) or None,
    )


def with_reading(info: ScanInfo, records: ScanRecords) -> ScanInfo:
    """Add to the description of a scan how its file was read."""
    unit = records.unit
    converted = () if unit is None or unit.name == METRE.name else (conversion(unit),)
    undecided = (records.open_unit,) if records.open_unit else ()
    marked = (left_out_in_words(records.left_out),) if records.left_out else ()
    no_height = (info.geocentric,) if info.geocentric else ()
    return replace(
        info,
        warnings=(*info.warnings, *converted, *undecided, *no_height, *marked, *records.warnings),
        unit=None if unit is None else unit.name,
        open_unit=records.open_unit or None,
        text_columns=records.text_columns,
        instrument=records.instrument,
        gps_time_s=records.gps_time_s,
        point_sources=None if records.point_sources is None else len(records.point_sources),
    )


def none_left(left_out: Mapping[str, int]) -> str:
    """Say why no point of a scan is left."""
    if left_out:
        return f"no point of the scan is left: {left_out_in_words(left_out)}; {UNMARK}"
    return "every record of the scan is marked as without a return"


def refused_info(refused: RefusedScan) -> ScanInfo:
    """Describe a scan that cannot be used for its file document."""
    return ScanInfo(
        index=refused.index,
        name=refused.name,
        points=0,
        dropped=0,
        structured=False,
        rows=None,
        columns=None,
        bounds_m=None,
        has_intensity=False,
        has_color=False,
        scan_pose=None,
        usable=False,
        reason=f"{refused.error.reason} (at {refused.error.place})" if refused.error.place else refused.error.reason,
    )


def conversion(unit: DeclaredUnit) -> str:
    """Say that coordinates were converted."""
    return f"the coordinates were converted from {unit.words} to metres, according to {unit.source}"


def check_count(
    file: ScanFile, count: int, smallest_record_bytes: float, limits: ReadLimits, place: str, *, spare: int = 0
) -> None:
    """Refuse a declared number of records before anything is allocated for it.

    Parameters
    ----------
    count
        What the header declares.
    smallest_record_bytes
        The least a record can occupy in this file.
    spare
        Bytes by which the end may be short of the rule (a last line without its newline).

    Raises
    ------
    UnreadableFileError
        The count is negative, or the file is too short for it.
    FileTooLargeError
        More records than `limits` allow.
    """
    if count < 0:
        raise file.unreadable(f"the header declares {count} points", place)
    if count * smallest_record_bytes > file.size + spare:
        raise file.unreadable(
            f"the header declares {count} points, which need at least {int(count * smallest_record_bytes)} bytes; "
            f"the file has {file.size}",
            place,
        )
    if count > limits.max_points:
        raise FileTooLargeError(f"{file.filename}, {place},", count, limits.max_points, "points")


def check_packing(file: ScanFile, count: int, place: str) -> None:
    """Refuse more points than any packing of measurements leaves room for: a small file may unpack to whole memories.

    Raises
    ------
    UnreadableFileError
        The file is too short for so many points that are not all the same.
    """
    most = FREE_POINTS + MOST_POINTS_PER_BYTE * file.size
    if count > most:
        raise file.unreadable(f"{count} points packed into {file.size} bytes are no measurements", place)


def times_of(seconds: Array) -> Floats32 | None:
    """Give times (n,) from their first on, which single precision then keeps to a millisecond; None if none differ."""
    known = np.isfinite(seconds)
    if not known.any():
        return None
    first = seconds[known].min()
    if seconds[known].max() == first:
        return None
    return np.where(known, seconds - first, np.nan).astype(np.float32)


def colors_8bit(channels: Array, largest: float) -> Colors:
    """Bring colour channels of the range 0 … `largest`, (n, 3), to 0 … 255."""
    if channels.dtype == np.uint8 and largest == 255:
        return np.ascontiguousarray(channels)
    if channels.dtype == np.uint16:
        # a table of all numbers that there can be is made faster than millions of channels are scaled
        return np.asarray(colors_8bit(np.arange(1 << 16, dtype=np.float32), largest)[channels])
    scaled = np.nan_to_num(np.asarray(channels, dtype=np.float32)) * np.float32(255.0 / largest)
    return np.asarray(np.clip(np.rint(scaled), 0, 255), dtype=np.uint8)


def in_metres(file: ScanFile, records: ScanRecords, place: str) -> ScanRecords:
    """Convert all lengths of a scan to metres; what is said by nobody is taken for metres."""
    declared, stated = records.unit, stated_unit(file)
    if stated is not None:
        if declared is not None and declared.name != stated.name:
            raise file.unreadable(
                f"the request says that coordinates are in {stated.words}, but according to "
                f"{declared.source} they are in {declared.words}",
                place,
            )
        declared = stated
    if declared is None or (declared.factors == 1.0).all():
        return records
    factors, pose = declared.factors, records.world_from_scan
    np.multiply(records.points, factors, out=records.points)
    return replace(
        records,
        base_m=None if records.base_m is None else records.base_m * factors,
        sensor_in_scan_m=None if records.sensor_in_scan_m is None else records.sensor_in_scan_m * factors,
        world_from_scan=None
        if pose is None
        else RigidTransform.from_components(pose.translation * factors, pose.rotation),
    )


def stated_unit(file: ScanFile) -> DeclaredUnit | None:
    """Return the unit that the owner of a file states."""
    return DeclaredUnit(BY_NAME[file.unit], BY_NAME[file.unit], "the request") if file.unit else None


def converted_unit(file: ScanFile, records: ScanRecords) -> DeclaredUnit | None:
    """Return the unit from which coordinates are converted; None: they are metres."""
    unit = stated_unit(file) or records.unit
    return None if unit is None or (unit.factors == 1.0).all() else unit


def finite(points: Points) -> Flags:
    """Say which points have three finite coordinates."""
    if np.isfinite(points.sum()):  # the common case, several times faster than looking row by row
        return np.ones(len(points), dtype=np.bool_)
    return np.asarray(np.isfinite(points).all(axis=1))


def bounds_of(points: Points) -> tuple[Vector3, Vector3]:
    """Give the least and the largest coordinates."""
    # column by column: reductions over the long axis of a narrow array are slow
    low_m = np.array([points[:, axis].min() for axis in range(3)])
    return low_m, np.array([points[:, axis].max() for axis in range(3)])


def _refuse_absurd(
    file: ScanFile, place: str, points: Points, low_m: Vector3, high_m: Vector3, base_m: Vector3, keep: Flags
) -> None:
    largest_m = float(np.maximum(np.abs(low_m + base_m), np.abs(high_m + base_m)).max())
    if largest_m > LARGEST_COORDINATE_M:
        worst = int(np.flatnonzero(keep)[np.argmax(np.abs(points + base_m).max(axis=1))])
        raise file.unreadable(
            f"a coordinate of {largest_m:.6g} m is beyond {LARGEST_COORDINATE_M:.0e} m", f"{place}, point {worst}"
        )
    if not (high_m > low_m).any():
        raise file.unreadable(f"all {len(points)} points of the scan are equal", place)
    if len(np.unique(points[:1000], axis=0)) < 4 and (found := len(np.unique(points, axis=0))) < 4:
        raise file.unreadable(f"the scan has {found} distinct points, at least 4 are needed", place)


def local_origin(low_m: Vector3, high_m: Vector3) -> Vector3:
    """Choose what is subtracted from coordinates between two corners [m]."""
    centre_m = 0.5 * (low_m + high_m)
    return np.zeros(3) if np.linalg.norm(centre_m) < NEAR_M else np.round(centre_m)


def _sensor(records: ScanRecords, low_m: Vector3, high_m: Vector3, origin_m: Vector3) -> Vector3 | None:
    if records.sensor_in_scan_m is None:
        return None
    sensor_m = np.asarray(records.sensor_in_scan_m - origin_m, dtype=np.float64)
    beyond = np.maximum(0.0, np.maximum(low_m - sensor_m, sensor_m - high_m))
    return sensor_m if np.linalg.norm(beyond) < LONGEST_RANGE_M else None


def _grid(records: ScanRecords, keep: Flags) -> ScanGrid | None:
    if records.row is None or records.column is None:
        return None
    row_0, column_0 = int(records.row.min()), int(records.column.min())
    rows, columns = int(records.row.max()) - row_0 + 1, int(records.column.max()) - column_0 + 1
    used = int(np.count_nonzero(keep))
    if rows < 2 or columns < 2 or used < SPARSEST_GRID * rows * columns:
        return None
    row, column = records.row[keep] - row_0, records.column[keep] - column_0
    index = np.full((rows, columns), -1, dtype=np.int32)
    # backwards, so that of several returns in one direction the first stays
    index[row[::-1], column[::-1]] = np.arange(used - 1, -1, -1, dtype=np.int32)
    return ScanGrid(index=index) if 2 * np.count_nonzero(index >= 0) > used else None
