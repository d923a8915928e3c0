"""Tetrahedra over triangles by minimum description length (after Sohn and Dowman 2002)."""

import numpy as np
from scipy.spatial import Delaunay

from algorithms.arrays import Array, Flags, OtherPoints, Points
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, lowest_points
from algorithms.terrain.code_lengths_kernels import shortest_splits
from algorithms.terrain.densification import Choice, grown, heights_of_net, lowest_of
from algorithms.terrain.options import MinimumDescription
from algorithms.terrain.triangulation import OverTriangles, corners_around


def mdl(points: Points, options: MinimumDescription, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground.

    Downwards: from four corners on, each triangle takes the lowest point below it, until there is none. Upwards: each
    triangle takes the point above it whose tetrahedron makes the description of all its points shortest, if it gets
    shorter than without. The description counts bits for distances of points near the terrain, for the heights of
    others, and for the bends of the terrain.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        What descriptions cost.
    cell_m
        Edge of the cells whose lowest points take part [m].
    progress
        Of the rounds.
    """
    grid = cells_over(points, cell_m)
    candidates = points[lowest_points(points, grid)]
    corners = corners_around(points, candidates[lowest_points(candidates, cells_over(candidates, options.corner_m))])
    downwards = lowest_of(lambda seen: np.asarray(seen.distances_m < 0.0))
    lower, above = grown(corners, candidates, downwards, ProgressSection(progress, 0.0, 0.3))
    terrain, _ = grown(lower, above, _upwards(options), ProgressSection(progress, 0.3, 1.0))
    return within_band(points, heights_of_net(terrain, grid), grid, options.tolerance_m, options.per_slope_m)


def _upwards(options: MinimumDescription) -> Choice:
    def chooses(seen: OverTriangles, left: Points, vertices: OtherPoints, net: Delaunay) -> Array:
        order = np.lexsort((seen.distances_m, seen.inside))
        starts = np.searchsorted(seen.inside[order], np.arange(len(net.simplices) + 1))
        return np.asarray(
            shortest_splits(
                left, seen.distances_m, order, starts, vertices, net.simplices, options.std_m, options.slope,
                options.object_height_m,
            )
        )  # fmt: skip

    return chooses
