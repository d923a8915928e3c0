"""The slope filter of Vosselman (2000), with the adaptive slope of Sithole and Vosselman (2001)."""

import numpy as np

from algorithms.arrays import Array, Flags, Points, Scalars
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.cell_heights import cells_over, filled, heights_on, lowest_heights, slopes_of
from algorithms.terrain.filters.opening import object_cells
from algorithms.terrain.neighbours import sorted_into_cells
from algorithms.terrain.neighbours_kernels import under_elements
from algorithms.terrain.options import SlopeFilter

CELLS_ALONG_RADIUS = 10
STEPS = 40
"""Of the curve of allowed heights."""
BLOCK = 200_000
ROUGH_SLOPE = 0.3
"""Of the openings that make the rough model."""


def slope(points: Points, options: SlopeFilter, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: z_p <= z_q + f(|pq|) for all points q within the radius.

    f(d) = `offset_m` + `slope` · d, or what was learned; adaptive, the slope of a rough model at p is added.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Radius and slopes.
    cell_m
        Edge of the cells of the rough model [m].
    """
    extra = added_slopes(points, options, cell_m, ProgressSection(progress, 0.0, 0.3))
    distances, allowed = curve_of(options)
    return under_curve(points, distances, allowed, extra, ProgressSection(progress, 0.3, 1.0))


def curve_of(options: SlopeFilter) -> tuple[Array, Array]:
    """Give distances from 0 to the radius, evenly spaced, and the height differences allowed there, (k,) [m]."""
    if options.allowed_m is not None:
        allowed = np.maximum.accumulate(options.allowed_m)
        return np.linspace(0.0, options.radius_m, len(allowed)), np.asarray(allowed)
    distances = np.linspace(0.0, options.radius_m, STEPS + 1)
    return distances, options.offset_m + options.slope * distances


def added_slopes(points: Points, options: SlopeFilter, cell_m: float, progress: Progress) -> Scalars:
    """Give the slope that the filter adds at each point (n,)."""
    if not options.adaptive:
        return np.zeros(len(points))
    return _rough_slopes(points, options.radius_m, cell_m, progress)


def under_curve(points: Points, distances: Array, allowed: Array, extra: Scalars, progress: Progress) -> Flags:
    """Tell which points (n,) no other one contradicts.

    Parameters
    ----------
    points
        (n, 3) [m].
    distances
        (k,) from 0 to the radius, evenly spaced [m].
    allowed
        (k,) largest height difference of two points on the ground [m], not falling.
    extra
        (n,) slope that is added at each point.
    progress
        Of the comparison.
    """
    edge = float(distances[-1]) / CELLS_ALONG_RADIUS
    cells = sorted_into_cells(points, edge)
    lowest, slopes = cells.lowest, extra[cells.order]
    parts = []
    for start in range(0, len(points), BLOCK):
        progress.report(start / len(points), "comparing with points around")
        parts.append(
            under_elements(
                cells.points, cells.cells, cells.starts, lowest, cells.grid.columns, edge, allowed, float(distances[1]),
                slopes, start, min(start + BLOCK, len(points)),
            )
        )  # fmt: skip
    return np.asarray(cells.as_before(np.concatenate(parts)))


def _rough_slopes(points: Points, radius_m: float, cell_m: float, progress: Progress) -> Scalars:
    """Give the slope of a terrain without what is narrower than the radius, at each point."""
    grid = cells_over(points, cell_m)
    lowest = lowest_heights(points, grid)
    objects = object_cells(filled(lowest), grid, radius_m, ROUGH_SLOPE, progress)
    coarse = cells_over(points, radius_m / 2.0)
    kept = ~np.isnan(lowest) & ~objects
    centres = np.column_stack([grid.centres(), np.zeros(kept.size)])
    cells = coarse.cells_of(centres[kept.ravel()])
    total = coarse.rows * coarse.columns
    counts = np.bincount(cells[cells >= 0], minlength=total)
    sums = np.bincount(cells[cells >= 0], lowest[kept][cells >= 0], total)
    rough = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan).reshape(coarse.shape)
    return heights_on(slopes_of(filled(rough), coarse), coarse, points)
