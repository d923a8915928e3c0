"""A triangulation of ground points that grows by points which its triangles accept."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import Delaunay

from algorithms.arrays import Array, Flags, OtherPoints, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.progress import Progress
from algorithms.terrain.cell_heights import filled
from algorithms.terrain.triangles_kernels import least_in_triangles
from algorithms.terrain.triangulation import OverTriangles, over_triangles, triangulated

MOST_ROUNDS = 15
ENOUGH = 0.01
"""A round that adds fewer points, as a share of those in the triangulation, is the last."""

Acceptance = Callable[[OverTriangles], Flags]
"""Tells which candidates are acceptable, from where they lie over their triangles."""
Choice = Callable[[OverTriangles, Points, OtherPoints, Delaunay], Array]
"""Gives for each triangle the number of the point that it takes, -1 for none, from where the points lie over their
triangles, the points, the vertices and the triangulation."""


def densified(vertices: OtherPoints, candidates: Points, accepts: Acceptance, progress: Progress) -> Array:
    """Add to each triangle, round after round, the acceptable point that is lowest over its plane.

    Parameters
    ----------
    vertices
        (m, 3) ground points that start the triangulation [m].
    candidates
        (n, 3) points that may be added [m].
    accepts
        The criterion.
    progress
        Of the rounds.

    Returns
    -------
    (k, 3) all points of the triangulation [m].
    """
    return grown(vertices, candidates, lowest_of(accepts), progress)[0]


def lowest_of(accepts: Acceptance) -> Choice:
    """Choose of the acceptable points of each triangle the one that is lowest over its plane."""

    def chooses(seen: OverTriangles, _left: Points, _vertices: OtherPoints, net: Delaunay) -> Array:
        return np.asarray(least_in_triangles(seen.inside, seen.distances_m, accepts(seen), len(net.simplices)))

    return chooses


def grown(vertices: OtherPoints, candidates: Points, chooses: Choice, progress: Progress) -> tuple[Array, Array]:
    """Add to each triangle, round after round, the point that is chosen for it, if any.

    Returns
    -------
    (k, 3) all points of the triangulation, and (l, 3) the candidates that are not in it [m].
    """
    grows: Array = vertices
    left: Array = candidates
    for turn in range(MOST_ROUNDS):
        net = triangulated(grows)
        progress.report(turn / MOST_ROUNDS, f"triangulation of {len(grows)} points")
        found = chooses(over_triangles(left, grows, net), left, grows, net)
        added = found[found >= 0]
        grows = np.vstack([grows, left[added]])
        keeps = np.ones(len(left), dtype=np.bool_)
        keeps[added] = False
        left = left[keeps]
        if len(added) < ENOUGH * len(grows) or len(left) == 0:
            break
    return grows, left


def near_or_below(distance_m: float, angle_rad: float) -> Acceptance:
    """Accept points near their triangle, by distance and by the angles seen from its corners, and all below it."""

    def accepts(seen: OverTriangles) -> Flags:
        near = (np.abs(seen.distances_m) <= distance_m) & (seen.angles_rad <= angle_rad)
        return np.asarray(near | (seen.distances_m < 0.0))

    return accepts


def heights_of_net(vertices: Points, grid: Grid) -> GridValues:
    """Give the heights of a triangulation in the middles of cells [m]; around it a membrane goes on."""
    centres = np.column_stack([grid.centres(), np.zeros(grid.rows * grid.columns)])
    return filled(over_triangles(centres, vertices, triangulated(vertices)).heights_m.reshape(grid.shape))
