"""Which points lie near a surface: above by no more than a tolerance that grows with its slope."""

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.terrain.cell_heights import heights_on, slopes_of


def within_band(points: Points, surface_m: GridValues, grid: Grid, tolerance_m: float, per_slope_m: float) -> Flags:
    """Tell which points (n,) lie within `tolerance_m` + `per_slope_m` · slope above or below a surface.

    Parameters
    ----------
    points
        (n, 3) [m].
    surface_m, grid
        Heights without gaps [m], and their cells.
    tolerance_m, per_slope_m
        Half the width of the band on level ground, and what is added at a slope of 1 [m].
    """
    gaps = np.abs(points[:, 2] - heights_on(surface_m, grid, points))
    slopes = heights_on(slopes_of(surface_m, grid), grid, points)
    return np.asarray(gaps <= tolerance_m + per_slope_m * slopes)
