"""Quantiles on finer and finer grids (Wack and Wimmer 2002)."""

import numpy as np
from scipy.ndimage import median_filter

from algorithms.arrays import Flags, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, heights_on, slopes_of
from algorithms.terrain.cell_heights_kernels import quantiles_in_cells
from algorithms.terrain.options import Quantile

AROUND = 5
"""Cells across of the window whose median a cell is compared with."""


def quantile(points: Points, options: Quantile, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: near a grid of low quantiles, refined from coarse to fine.

    On each level cells that stand above those around by more than `jump` · cell are dropped and filled; the next level
    sees the points in a band around what is left.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Levels and thresholds.
    cell_m
        Not used: the levels say it.
    progress
        Of the levels.
    """
    _ = cell_m
    inside = np.arange(len(points))
    grid, terrain = cells_over(points, options.levels_m[0]), np.zeros((1, 1))
    for k, edge in enumerate(options.levels_m):
        progress.report(k / len(options.levels_m), f"cells of {edge:g} m")
        grid = cells_over(points, edge)
        heights = quantiles_of_cells(points[inside], grid, options.share)
        around = median_filter(filled(heights), size=AROUND, mode="nearest")
        limit = options.jump * edge * (1.0 + slopes_of(around, grid))
        terrain = filled(np.where(heights - around > limit, np.nan, heights))
        above = points[:, 2] - heights_on(terrain, grid, points)
        inside = np.flatnonzero(
            np.abs(above) <= options.band * edge * (1.0 + _at(slopes_of(terrain, grid), grid, points))
        )
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)


def _at(values: GridValues, grid: Grid, points: Points) -> np.ndarray:
    return heights_on(values, grid, points)


def quantiles_of_cells(points: Points, grid: Grid, share: float) -> GridValues:
    """Give the height below which a share of the points of each cell lies [m]; NaN for none."""
    found = quantiles_in_cells(grid.cells_of(points), points[:, 2], grid.rows * grid.columns, share)
    return np.asarray(found.reshape(grid.shape))
