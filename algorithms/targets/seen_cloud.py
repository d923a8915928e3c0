"""A scan as the search for targets sees it: points about the instrument, and which are near a place."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Floats32, Indices, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError
from algorithms.scans.scan import Scan

SAMPLED_DIRECTIONS = 4000
"""Directions whose neighbours tell the angular step of an unstructured scan."""
REPEATED_TURN, LEAST_COLUMNS = 0.4, 64
"""A raster that goes all around goes on for so much [rad]: no target looks wider."""
ADJOINING = 0.75
"""Columns adjoin that are one step apart to so much of it."""
ONE_WAY = 0.9
"""A column whose mean direction is shorter than this looks to the front and to the back."""
LEAST_POINTS = 10
"""Fewer points show no target."""


@dataclass(frozen=True, eq=False)
class SeenCloud:
    """Points relative to the instrument."""

    points: Points
    """(n, 3) relative to the instrument, in the scan's axes [m]."""
    sensor_m: Vector3
    """(3,) the instrument in the scan's reduced frame [m]."""
    intensity: Scalars | None
    """(n,) as in the scan, none below zero."""
    index: Array
    """(rows, columns) number of the point seen in each cell of a raster of directions, -1 for none; where it goes all
    around, its first columns follow once more after the last, so that nothing is cut off at the seam."""
    row_step_rad: float
    """Angle between rows."""
    column_step_rad: float
    """Angle between columns at the horizon."""
    structured: bool
    """Whether the raster is the scanner's own."""

    @cached_property
    def ranges(self) -> Scalars:
        """(n,) distances from the instrument [m]."""
        return np.asarray(np.linalg.norm(self.points, axis=1))

    @cached_property
    def tree(self) -> cKDTree:
        """Finds points near a place."""
        return cKDTree(self.points, balanced_tree=False, compact_nodes=False)

    @property
    def step_rad(self) -> float:
        """The larger of the two angular steps."""
        return max(self.row_step_rad, self.column_step_rad)

    def near(self, place_m: Vector3, radius_m: float) -> Indices:
        """Give the numbers of the points within a radius of a place (relative to the instrument)."""
        return np.asarray(sorted(self.tree.query_ball_point(place_m, radius_m)), dtype=np.int64)


def seen_cloud(scan: Scan) -> SeenCloud:
    """Lay a scan out about its instrument.

    Parameters
    ----------
    scan
        Structured or not. Where it does not tell the instrument's place, the frame's origin is taken, if the scan lies
        around it.

    Raises
    ------
    InvalidInputError
        For a scan without points, or whose instrument's place cannot be known.
    """
    if len(scan) < LEAST_POINTS:
        raise InvalidInputError("scan", f"{len(scan)} points show no target")
    sensor = scan.sensor_m if scan.sensor_m is not None else -np.asarray(scan.origin_m, dtype=np.float64)
    low, high = scan.points.min(axis=0), scan.points.max(axis=0)
    if scan.sensor_m is None and scan.grid is None and not np.all((sensor >= low) & (sensor <= high)):
        raise InvalidInputError(
            "scan",
            "the place of the instrument is not known",
            "give the scan in the scanner's own frame, or a structured file",
        )
    points = np.ascontiguousarray(scan.points - sensor)
    intensity = None if scan.intensity is None else _amplitudes(scan.intensity)
    if scan.grid is not None:
        rows, columns = _steps_of_grid(points, scan.grid.index)
        return SeenCloud(
            points, sensor, intensity, closed_raster(points, scan.grid.index), rows, columns, structured=True
        )
    step = _angular_spacing(points)
    index = closed_raster(points, _raster(points, step))
    return SeenCloud(points, sensor, intensity, index, step, step, structured=False)


def _amplitudes(intensity: Floats32) -> Scalars:
    """Return intensities (n,) of which twice the number is twice as bright: those below zero are decibels."""
    found = intensity.astype(np.float64)
    return np.asarray(10.0 ** (0.1 * found)) if np.nanmin(found, initial=0.0) < 0.0 else found


def closed_raster(points: Points, index: Array) -> Array:
    """Repeat the first columns (rows, columns + k) of a raster behind its last, if they adjoin; else leave it.

    Where a scanner turns on past its start, the columns follow that come after its last one.
    """
    columns = index.shape[1]
    repeated = int(columns * REPEATED_TURN / (2.0 * np.pi))
    if repeated < 1 or columns < LEAST_COLUMNS:
        return index
    first = _azimuths(points, index[:, :repeated])
    last = _azimuths(points, index[:, -repeated:])
    steps = np.concatenate([_turned(np.diff(first)), _turned(np.diff(last))])
    steps = steps[np.isfinite(steps)]
    if len(steps) == 0 or not np.any(np.isfinite(last)):
        return index
    step = float(np.median(steps))
    end = int(np.flatnonzero(np.isfinite(last))[-1])
    behind = step * (len(last) - 1 - end)
    off = np.abs(_turned(first - last[end] - behind - step))
    if not np.any(off < ADJOINING * abs(step)):
        return index
    start = int(np.nanargmin(off))
    return np.hstack([index, index[:, start : start + repeated]])


def _azimuths(points: Points, index: Array) -> Array:
    """Give the mean azimuth (k,) of each column [rad], NaN where it has no points or looks both ways."""
    rows, columns = np.nonzero(index >= 0)
    level = points[index[rows, columns], :2]
    level = level / np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    sums = [np.bincount(columns, level[:, k], index.shape[1]) for k in (0, 1)]
    count = np.maximum(np.bincount(columns, minlength=index.shape[1]), 1)
    return np.where(np.hypot(*sums) > ONE_WAY * count, np.arctan2(sums[1], sums[0]), np.nan)


def _turned(angles: Array) -> Array:
    """Give angles between -π and π."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)


def _steps_of_grid(points: Points, index: Array) -> tuple[float, float]:
    """Give the median angle between neighbours in a column, and in a row reduced to the horizon [rad]."""
    steps = []
    for axis in (0, 1):
        length = index.shape[axis]
        one, other = index.take(range(length - 1), axis), index.take(range(1, length), axis)
        both = np.flatnonzero(((one >= 0) & (other >= 0)).ravel())
        if len(both) == 0:
            raise InvalidInputError("scan", "its grid has no neighbours")
        both = both[:: max(1, len(both) // 20_000)]
        a, b = points[one.ravel()[both]], points[other.ravel()[both]]
        angles = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
        if axis == 1:
            horizontal = np.linalg.norm(a[:, :2], axis=1) / np.linalg.norm(a, axis=1)
            angles = angles / np.maximum(horizontal, 0.05)
        steps.append(float(np.median(angles)))
    return steps[0], steps[1]


def _angular_spacing(points: Points) -> float:
    """Estimate the angle between neighbouring beams from the distances of directions [rad]."""
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    tree = cKDTree(directions, balanced_tree=False, compact_nodes=False)
    chosen = directions[:: max(1, len(directions) // SAMPLED_DIRECTIONS)]
    distances = np.asarray(tree.query(chosen, k=min(5, len(directions)))[0])
    # the four nearest in a raster are one step away; of scattered directions they are as near on the average
    return float(max(np.median(distances[:, -1]), 1e-6))


def _raster(points: Points, step_rad: float) -> Array:
    """Enter every point into its cell of azimuth and elevation; the nearest counts."""
    azimuths = np.arctan2(points[:, 1], points[:, 0])
    elevations = np.arctan2(points[:, 2], np.linalg.norm(points[:, :2], axis=1))
    left, top = azimuths.min(), elevations.max()
    columns = ((azimuths - left) / step_rad).astype(np.int64)
    rows = ((top - elevations) / step_rad).astype(np.int64)
    index = np.full((int(rows.max()) + 1, int(columns.max()) + 1), -1, dtype=np.int32)
    farthest_first = np.argsort(-np.einsum("ij,ij->i", points, points), kind="stable")
    index[rows[farthest_first], columns[farthest_first]] = farthest_first
    return index
