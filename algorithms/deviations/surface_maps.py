"""Maps that tell what a surface model is worth: density, distance to the nearest point, residuals.

M. Attwenger, C. Briese, *Vergleich digitaler Geländemodelle aus Photogrammetrie und Laserscanning*, VGI 4/2003,
sections 4 and 5.
"""

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points
from algorithms.deviations.rasters import Grid, GridValues, heights_at

Values = Array
"""(n,) numbers."""


def density_map(uvh: Points, grid: Grid) -> GridValues:
    """Give the points per square metre of each cell; 0 where none is."""
    cells = grid.cells_of(uvh)
    counts = np.bincount(cells[cells >= 0], minlength=grid.rows * grid.columns)
    return np.asarray(counts.reshape(grid.shape) / grid.cell_m**2)


def distance_map(uvh: Points, grid: Grid) -> GridValues:
    """Give the horizontal distance from the middle of each cell to the nearest measured point [m]; O(cells log n)."""
    lengths, _ = cKDTree(uvh[:, :2]).query(grid.centres())
    return np.asarray(lengths).reshape(grid.shape)


def residuals_of(uvh: Points, surface_m: GridValues, grid: Grid) -> Values:
    """Give the heights (n,) of points above a surface on a grid [m]; NaN where it is not defined."""
    return np.asarray(uvh[:, 2] - heights_at(surface_m, grid, uvh))


def rms_map(uvh: Points, residuals_m: Values, units: Grid) -> GridValues:
    """Give the root mean square of the points' residuals in each analysis unit [m]; NaN where there are none.

    Parameters
    ----------
    uvh
        (n, 3) points.
    residuals_m
        (n,) their heights above the surface.
    units
        Analysis units, usually larger than the surface's cells (the source takes 25 m² over a 1 m model).
    """
    cells = units.cells_of(uvh)
    used = (cells >= 0) & np.isfinite(residuals_m)
    total = units.rows * units.columns
    counts = np.bincount(cells[used], minlength=total)
    squares = np.bincount(cells[used], residuals_m[used] ** 2, minlength=total)
    means = np.sqrt(squares / np.maximum(counts, 1))
    return np.where(counts > 0, means, np.nan).reshape(units.shape)
