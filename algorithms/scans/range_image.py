"""What an instrument saw in each direction."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from algorithms.arrays import Array, Labels, Points, Vector3

POINTS_PER_IMAGE = 1 << 19
"""Fewer points are not worth a range image of their own, which all must be united."""


@dataclass(frozen=True, eq=False)
class SphericalRangeImage:
    """Smallest and largest range per direction cell, seen from the sensor."""

    sensor_m: Vector3
    """Position of the instrument in the reduced scan frame [m]."""
    cell_rad: float
    """Angular size of a cell [rad]."""
    nearest_m: Array
    """(rows, columns) float32 smallest relevant range, inf where nothing was seen. Rows: zenith angle from +z, 0..pi;
    columns: azimuth atan2(y, x) from -pi."""
    farthest_m: Array
    """(rows, columns) float32 largest range, 0 where nothing was seen."""


class Visibility(IntEnum):
    """What a range image says about a point."""

    UNKNOWN = 0
    """Nothing came back from that direction: neither free nor occupied."""
    FREE = 1
    """The instrument looked through that place: no surface can be there."""
    SURFACE = 2
    """A surface was measured in that direction at about that range."""
    HIDDEN = 3
    """The place lies behind what was seen."""


def spherical_range_image(
    points: Points, sensor_m: Vector3, cell_rad: float, *, splat_m: float = 0.0
) -> SphericalRangeImage:
    """Enter every point into the direction cell in which the instrument saw it.

    Parameters
    ----------
    points
        (n, 3) points [m].
    sensor_m
        Position of the instrument in the same frame [m].
    cell_rad
        Angular size of a cell [rad]; rounded down so that whole cells fill the sphere.
    splat_m
        Radius of the disc a point stands for [m]: half the spacing of a thinned cloud, so that one cannot look
        through the gaps between near points at what lies behind them. 0 enters the point's own cell only.

    Returns
    -------
    Range image; directions without a point stay unknown.
    """
    from algorithms.scans import range_image_kernels as kernels
    from algorithms.scans.point_blocks import over_blocks

    rows = max(2, math.ceil(math.pi / cell_rad - 1e-9))
    cell = math.pi / rows
    points, sensor = np.ascontiguousarray(points), np.ascontiguousarray(sensor_m)

    def work(start: int, end: int) -> tuple[Array, Array]:
        nearest = np.full((rows, 2 * rows), np.inf, dtype=np.float32)
        farthest = np.zeros((rows, 2 * rows), dtype=np.float32)
        kernels.fill(points, sensor, cell, float(splat_m), start, end, nearest, farthest)
        return nearest, farthest

    parts = over_blocks(work, len(points), least=POINTS_PER_IMAGE)
    nearest = np.minimum.reduce([part[0] for part in parts])
    farthest = np.maximum.reduce([part[1] for part in parts])
    return SphericalRangeImage(np.asarray(sensor_m, dtype=np.float64), cell, nearest, farthest)


def conservative_nearest_m(seen: SphericalRangeImage) -> Array:
    """Give the smallest range of each cell's 3 x 3 neighbourhood, (rows, columns) float32 [m].

    Space nearer than this was looked through in the whole neighbourhood, so a point's own position noise, the cell
    raster and silhouette edges cannot turn occupied space into free space. Where no ray fell into a neighbour, what is
    seen next to that one may reach into it: surface met at a flat angle at the rim of a column is narrower than the
    steps of a scan are wide.
    """
    from algorithms.scans import range_image_kernels as kernels

    filled, out = np.empty_like(seen.nearest_m), np.empty_like(seen.nearest_m)
    kernels.smallest_around(seen.nearest_m, True, filled)
    kernels.smallest_around(filled, False, out)
    # A cell in which nothing was seen stays unknown, whatever its neighbours saw.
    out[~np.isfinite(seen.nearest_m)] = np.inf
    return out


def visibility(
    points: Points, seen: SphericalRangeImage, *, margin_m: float = 0.15, margin_relative: float = 0.012
) -> Labels:
    """Tell for each point whether the instrument looked through its place, measured a surface there, or saw nothing.

    Parameters
    ----------
    points
        (n, 3) points in the frame of `seen` [m].
    seen
        What the instrument saw.
    margin_m, margin_relative
        A point is in free space when it is nearer than the conservative range minus `margin_m` minus
        `margin_relative` times that range, and hidden when it is farther than the farthest range by as much.

    Returns
    -------
    (n,) `Visibility` values.
    """
    from algorithms.scans import range_image_kernels as kernels

    ranges = np.empty((len(points), 3))
    kernels.cell_ranges(
        np.ascontiguousarray(points),
        seen.sensor_m,
        seen.cell_rad,
        conservative_nearest_m(seen),
        seen.farthest_m,
        ranges,
    )
    own, nearest, farthest = ranges.T
    known = np.isfinite(nearest)
    out = np.full(len(points), int(Visibility.UNKNOWN), dtype=np.int32)
    bound = np.where(known, nearest, 0.0)
    out[known] = int(Visibility.SURFACE)
    out[known & (own < bound - margin_m - margin_relative * bound)] = int(Visibility.FREE)
    out[known & (own > farthest + margin_m + margin_relative * farthest)] = int(Visibility.HIDDEN)
    return out
