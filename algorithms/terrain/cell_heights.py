"""Heights on square cells: the lowest points, gaps filled, and what the grid says at a place."""

import math

import numpy as np
from jaxtyping import Bool
from scipy.ndimage import distance_transform_edt

from algorithms.arrays import Array, Points, Scalars
from algorithms.deviations.rasters import Grid, GridValues, grid_over
from algorithms.errors import InvalidInputError
from algorithms.terrain.cell_heights_kernels import lowest_in_cells, relax_gaps

SWEEPS, OVER_RELAXATION = 60, 1.7
"""Of the membrane at each level; started from the next coarser one, it needs no more."""

GridFlags = Bool[Array, "rows columns"]


def spacing_of(points: Points) -> float:
    """Give the mean spacing of points in plan: the edge of a square that holds one of them [m]."""
    extent = np.maximum(np.ptp(points[:, :2], axis=0), 1e-3)
    # the share of the box that is covered is counted in cells of about ten points
    coarse = math.sqrt(float(extent.prod()) * 10.0 / len(points))
    grid = _padded(points, coarse)
    covered = int((np.bincount(grid.cells_of(points)) > 0).sum()) * coarse**2
    return math.sqrt(min(covered, float(extent.prod())) / len(points))


def cells_over(points: Points, cell_m: float) -> Grid:
    """Lay square cells over all points.

    Raises
    ------
    InvalidInputError
        No points, or too many cells.
    """
    if len(points) == 0:
        raise InvalidInputError("terrain", "no point is left", "use another filter, or larger bands")
    return _padded(points, cell_m)


def _padded(points: Points, cell_m: float) -> Grid:
    corners = np.stack([points.min(axis=0), points.max(axis=0)])
    corners[1] += 1e-6 * cell_m + 1e-9  # a point on the last border is within the last cell
    return grid_over([corners], cell_m, overlap=False)


def lowest_points(points: Points, grid: Grid) -> Array:
    """Give the numbers of the lowest point of each cell that has one, row by row, (m,)."""
    found = lowest_in_cells(grid.cells_of(points), points[:, 2], grid.rows * grid.columns)
    return np.asarray(found[found >= 0])


def lowest_heights(points: Points, grid: Grid) -> GridValues:
    """Give the height of the lowest point of each cell [m]; NaN for none."""
    out = np.full(grid.rows * grid.columns, np.nan)
    numbers = lowest_points(points, grid)
    out[grid.cells_of(points[numbers])] = points[numbers, 2]
    return out.reshape(grid.shape)


def highest_heights(points: Points, grid: Grid) -> GridValues:
    """Give the height of the highest point of each cell [m]; NaN for none."""
    return -lowest_heights(points * [1.0, 1.0, -1.0], grid)


def filled(heights: GridValues) -> GridValues:
    """Fill the unknown cells (NaN) by a membrane over them: each becomes the mean of its neighbours.

    Coarse cells give the start of finer ones. O(cells).

    Raises
    ------
    InvalidInputError
        No cell is known.
    """
    known = np.isfinite(heights)
    if known.all():
        return heights.copy()
    if not known.any():
        raise InvalidInputError("terrain", "no cell has a height", "use larger cells or another filter")
    rows, columns = heights.shape
    if min(rows, columns) <= 2:
        out = np.where(known, heights, heights[known].mean())
    else:
        coarse = filled(_halved(heights, known))
        out = np.where(known, heights, coarse.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns])
    relax_gaps(out, known, SWEEPS, OVER_RELAXATION)
    relax_gaps(out, known, 2, 1.0)
    return out


def _halved(heights: GridValues, known: GridFlags) -> Array:
    rows, columns = (-(-side // 2) for side in heights.shape)
    pad = ((0, 2 * rows - heights.shape[0]), (0, 2 * columns - heights.shape[1]))
    sums = np.pad(np.where(known, heights, 0.0), pad).reshape(rows, 2, columns, 2).sum(axis=(1, 3))
    counts = np.pad(known, pad).reshape(rows, 2, columns, 2).sum(axis=(1, 3))
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)


def wide_gaps(known: GridFlags, cell_m: float, width_m: float) -> GridFlags:
    """Return the cells (rows, columns) over which a disc fits that touches no known cell.

    Parameters
    ----------
    known
        (rows, columns) cells with points.
    cell_m
        Edge of the cells [m].
    width_m
        Diameter of the disc [m].
    """
    if not known.any():
        return np.ones(known.shape, dtype=np.bool_)
    radius = 0.5 * width_m / cell_m
    middles = distance_transform_edt(~known) > radius
    if not middles.any():
        return middles
    return np.asarray((distance_transform_edt(~middles) <= radius) & ~known)


def heights_on(surface_m: GridValues, grid: Grid, points: Points) -> Scalars:
    """Interpolate a surface without gaps bilinearly, (n,) [m]; beyond the border's middles it stays level."""
    column, row = (grid.places(points) - 0.5).T
    column = np.clip(column, 0.0, grid.columns - 1.0)
    row = np.clip(row, 0.0, grid.rows - 1.0)
    c0 = np.minimum(column.astype(np.int64), max(grid.columns - 2, 0))
    r0 = np.minimum(row.astype(np.int64), max(grid.rows - 2, 0))
    c1, r1 = np.minimum(c0 + 1, grid.columns - 1), np.minimum(r0 + 1, grid.rows - 1)
    s, t = column - c0, row - r0
    return np.asarray(
        (1.0 - t) * ((1.0 - s) * surface_m[r0, c0] + s * surface_m[r0, c1])
        + t * ((1.0 - s) * surface_m[r1, c0] + s * surface_m[r1, c1])
    )


def slopes_of(surface_m: GridValues, grid: Grid) -> GridValues:
    """Give the tangent of the steepest slope of each cell, by central differences."""
    if min(surface_m.shape) < 2:
        return np.zeros(surface_m.shape)
    along_v, along_u = np.gradient(surface_m, grid.cell_m)
    return np.asarray(np.hypot(along_u, along_v))
