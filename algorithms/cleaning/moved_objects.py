"""Points that stand where another station looked through: whatever they belong to was not there, or not yet."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from algorithms.arrays import Flags, Points, Vector3
from algorithms.cleaning.options import MovedObjects
from algorithms.scans import surface_index_kernels as kernels
from algorithms.scans.range_image import SphericalRangeImage, conservative_nearest_m, spherical_range_image
from algorithms.scans.voxel_grid import voxel_cells

CELL_RAD = float(np.radians(0.5))
"""Angular cell of the range images, unless the points of a station are farther apart."""
CELL_STEPS = 2.5
"""A cell is so many times as wide as the points are apart."""
MARGIN_RELATIVE = 0.002
"""Of the range, added to the margin: errors of rotation."""
GAP_M = 0.10
"""Pieces hang together through cubes of this edge that touch, or of some spacings of the points [m]."""
SPACINGS = 3.0


def seen_space(points: Points, sensor_m: Vector3, step_rad: float) -> SphericalRangeImage:
    """Give what a station saw; `step_rad` is the angle between its points [rad]."""
    return spherical_range_image(points, sensor_m, max(CELL_RAD, CELL_STEPS * step_rad))


def in_free_space(points: Points, normals: Points, seen: SphericalRangeImage, options: MovedObjects) -> Flags:
    """Mark the points (n, 3) that stand where a station looked through.

    Points without a normal (n, 3) are not judged: at a grazing angle nobody can tell what was seen behind them.
    """
    out = np.zeros(len(points), dtype=np.bool_)
    if len(points) == 0:
        return out
    rays = np.ascontiguousarray((points - seen.sensor_m).T)
    nearest = conservative_nearest_m(seen)
    kernels.seen_through(
        rays, normals, nearest, seen.cell_rad, options.margin_m, MARGIN_RELATIVE, options.margin_m, out
    )
    return out


def whole_pieces(points: Points, marked: Flags, spacing_m: float, least_points: int) -> Flags:
    """Keep the mark of those points only that hang together in pieces of at least so many.

    Parameters
    ----------
    points
        (n, 3) of one station [m].
    marked
        (n,) in free space.
    spacing_m
        Typical distance of the points [m].
    least_points
        Of a piece.
    """
    numbers = np.flatnonzero(marked)
    out = np.zeros(len(points), dtype=np.bool_)
    if len(numbers) < least_points:
        return out
    some = points[numbers]
    cells = voxel_cells(some, max(GAP_M, SPACINGS * spacing_m))
    rows, columns = np.nonzero(cells.neighbours >= 0)
    ends = (rows, cells.neighbours[rows, columns])
    links = coo_array((np.ones(len(rows), dtype=bool), ends), shape=(len(cells), len(cells)))
    labels = connected_components(links, directed=False)[1][cells.cell_of_point]
    counts = np.bincount(labels)
    out[numbers[counts[labels] >= least_points]] = True
    return out
