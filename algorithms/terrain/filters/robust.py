"""Robust interpolation (Kraus and Pfeifer 1998): linear prediction with asymmetric weights."""

import numpy as np

from algorithms.arrays import Array, Flags, OtherPoints, Points
from algorithms.deviations.rasters import Grid
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, lowest_heights, lowest_points
from algorithms.terrain.filters.opening import object_cells
from algorithms.terrain.linear_prediction import Covariance, predicted_grid
from algorithms.terrain.options import Robust
from algorithms.terrain.robust_surface import WeightFunction, robust_weights


def robust(points: Points, options: Robust, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: near the surface that their lowest, weighted, predict.

    The method needs ground and objects mixed, and large roofs are not. So points in cells that growing openings call
    objects have no weight in the first round; the surface brings back those that lie near it.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Covariance and weight function.
    cell_m
        Edge of the cells of the terrain [m].
    """
    data = points[lowest_points(points, cells_over(points, options.thin_m))]
    covariance = Covariance(options.correlation_m, options.relief_m, options.noise_m)
    function = WeightFunction(options.half_width_m, options.cut_m)
    grid = cells_over(points, cell_m)
    start = _start_weights(data, points, grid, options, ProgressSection(progress, 0.0, 0.1))
    weights, _ = robust_weights(data, covariance, function, ProgressSection(progress, 0.1, 0.8), start)
    terrain, _ = predicted_grid(data, weights, grid, covariance, ProgressSection(progress, 0.8, 1.0))
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)


def _start_weights(data: OtherPoints, points: Points, grid: Grid, options: Robust, progress: Progress) -> Array:
    objects = object_cells(filled(lowest_heights(points, grid)), grid, options.window_m, options.slope, progress)
    return np.where(objects.ravel()[grid.cells_of(data)], 0.0, 1.0)
