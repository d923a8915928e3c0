"""Hierarchical robust interpolation (Pfeifer, Stadler and Briese 2001): from coarse to fine."""

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, heights_on, lowest_points
from algorithms.terrain.linear_prediction import Covariance, predicted_grid
from algorithms.terrain.options import Hierarchical
from algorithms.terrain.robust_surface import WeightFunction, robust_weights

CORRELATION, RELIEF = 4.0, 2.0
"""Of a level, per metre of its cells."""
HALF_WIDTH, CUT = 0.4, 1.5
"""Of the weight function of a level, per metre of its cells."""


def hierarchical(points: Points, options: Hierarchical, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground.

    Each level takes the lowest points of its cells, from all points at first, then from those in a band around the
    terrain of the level before, and predicts the terrain robustly.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Levels and bands.
    cell_m
        Edge of the cells of the terrain [m].
    """
    inside = np.arange(len(points))
    grid = cells_over(points, cell_m)
    terrain = np.zeros(grid.shape)
    for k, edge in enumerate(options.levels_m):
        part = ProgressSection(progress, k / len(options.levels_m), (k + 1) / len(options.levels_m))
        data = points[inside][lowest_points(points[inside], cells_over(points[inside], edge))]
        covariance = Covariance(CORRELATION * edge, RELIEF * edge, options.noise_m * max(1.0, edge / cell_m) ** 0.5)
        function = WeightFunction(HALF_WIDTH * edge, CUT * edge)
        weights, _ = robust_weights(data, covariance, function, ProgressSection(part, 0.0, 0.8))
        terrain, _ = predicted_grid(data, weights, grid, covariance, ProgressSection(part, 0.8, 1.0))
        above = points[:, 2] - heights_on(terrain, grid, points)
        inside = np.flatnonzero(np.abs(above) <= options.band * edge)
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)
