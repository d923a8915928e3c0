"""Progressive densification of a triangulation (Axelsson 2000)."""

import numpy as np

from algorithms.arrays import Array, Flags, Indices, OtherPoints, Points, Scalars
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, lowest_heights, lowest_points
from algorithms.terrain.filters.opening import object_cells
from algorithms.terrain.options import Tin
from algorithms.terrain.triangles_kernels import least_in_triangles
from algorithms.terrain.triangulation import corners_around, over_triangles, triangulated

MOST_ROUNDS = 15
ENOUGH = 0.01
"""A round that adds fewer points, as a share of those in the triangulation, is the last."""


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
    candidates = points[lowest_points(points, cells_over(points, cell_m))]
    seeds = _certain(candidates, options, cell_m, progress)
    vertices = np.vstack([corners_around(points, seeds), seeds])
    angle = np.radians(options.angle_deg)
    for turn in range(MOST_ROUNDS):
        net = triangulated(vertices)
        progress.report(turn / MOST_ROUNDS, f"triangulation of {len(vertices)} points")
        seen = over_triangles(candidates, vertices, net)
        distances = np.abs(seen.distances_m)
        near = (distances <= options.distance_m) & (seen.angles_rad <= angle)
        below = (seen.distances_m < 0.0) & np.isfinite(distances)
        added = _one_of_each(seen.inside, seen.distances_m, near | below, len(net.simplices))
        if len(added) == 0:
            break
        vertices = np.vstack([vertices, candidates[added]])
        left = np.ones(len(candidates), dtype=np.bool_)
        left[added] = False
        candidates = candidates[left]
        if len(added) < ENOUGH * len(vertices):
            break
    grid = cells_over(points, cell_m)
    centres = np.column_stack([grid.centres(), np.zeros(grid.rows * grid.columns)])
    terrain = over_triangles(centres, vertices, triangulated(vertices)).heights_m.reshape(grid.shape)
    return within_band(points, filled(terrain), grid, options.tolerance_m, options.per_slope_m)


def _certain(points: Points, options: Tin, cell_m: float, progress: Progress) -> OtherPoints:
    grid = cells_over(points, cell_m)
    objects = object_cells(filled(lowest_heights(points, grid)), grid, options.window_m, options.slope, progress)
    ground = points[~objects.ravel()[grid.cells_of(points)]]
    return np.asarray(ground[lowest_points(ground, cells_over(ground, options.seed_m))])


def _one_of_each(inside: Indices, measures: Scalars, accepted: Flags, triangles: int) -> Array:
    found = least_in_triangles(inside, measures, accepted, triangles)
    return np.asarray(found[found >= 0])
