"""Progressive densification of a triangulation (Axelsson 2000)."""

import numpy as np

from algorithms.arrays import Flags, OtherPoints, Points
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, lowest_heights, lowest_points
from algorithms.terrain.densification import densified, heights_of_net, near_or_below
from algorithms.terrain.filters.opening import object_cells
from algorithms.terrain.options import Tin
from algorithms.terrain.triangulation import corners_around


def tin(points: Points, options: Tin, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground.

    The lowest point of every square starts a triangulation, unless openings by growing windows call it an object. In
    each round every triangle takes the lowest over its plane of the points inside whose distance and angles stay below
    the thresholds; points below the triangulation are taken whatever their angle. Candidates are the lowest points of
    cells; in the end all points near the triangles are ground.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Squares and thresholds.
    cell_m
        Edge of the cells [m].
    """
    grid = cells_over(points, cell_m)
    candidates = points[lowest_points(points, grid)]
    seeds = _certain(candidates, options, cell_m, progress)
    vertices = np.vstack([corners_around(points, seeds), seeds])
    accepts = near_or_below(options.distance_m, float(np.radians(options.angle_deg)))
    terrain = heights_of_net(densified(vertices, candidates, accepts, progress), grid)
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)


def _certain(points: Points, options: Tin, cell_m: float, progress: Progress) -> OtherPoints:
    grid = cells_over(points, cell_m)
    objects = object_cells(filled(lowest_heights(points, grid)), grid, options.window_m, options.slope, progress)
    ground = points[~objects.ravel()[grid.cells_of(points)]]
    return np.asarray(ground[lowest_points(ground, cells_over(ground, options.seed_m))])
