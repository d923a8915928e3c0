"""Triangulations of points in plan, and points over them."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from algorithms.arrays import Array, CorePoints, Indices, OtherPoints, Points, Scalars
from algorithms.errors import InvalidInputError
from algorithms.terrain.triangles_kernels import seen_from_triangles, walk_to_triangles

CORNER_MARGIN = 0.05
"""Of the extent, by which the corners lie outside of it: every point is in a triangle then."""


@dataclass(frozen=True, eq=False)
class OverTriangles:
    """Points over the triangles they lie in."""

    inside: Indices
    """(n,) number of the triangle, -1 for none."""
    distances_m: Scalars
    """(n,) from its plane, positive above [m]."""
    angles_rad: Scalars
    """(n,) largest angle between the plane and the lines to the corners [rad]."""
    heights_m: Scalars
    """(n,) of the triangle at the point [m]."""


def triangulated(points: Points) -> Delaunay:
    """Give the Delaunay triangulation of points in plan.

    Raises
    ------
    InvalidInputError
        They lie on a line.
    """
    try:
        return Delaunay(points[:, :2])
    except QhullError:
        why = f"{len(points)} points on a line in plan make no triangles"
        raise InvalidInputError("terrain", why, "give points of an area") from None


def over_triangles(points: Points, vertices: OtherPoints, net: Delaunay) -> OverTriangles:
    """Say where points lie over a triangulation; O(n + triangles)."""
    _, nearest = cKDTree(vertices[:, :2]).query(points[:, :2])
    start = net.vertex_to_simplex[nearest].astype(np.int64)
    inside = walk_to_triangles(points, vertices, net.simplices, net.neighbors, start)
    return OverTriangles(inside, *seen_from_triangles(points, vertices, net.simplices, inside))


def corners_around(points: Points, ground: OtherPoints) -> CorePoints:
    """Give four corners outside of all points, each as high as the ground point nearest to it, (4, 3) [m]."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    margin = CORNER_MARGIN * (high - low) + 1.0
    low, high = low - margin, high + margin
    plan = np.array([[low[0], low[1]], [high[0], low[1]], [low[0], high[1]], [high[0], high[1]]])
    gaps: Array = ((plan[:, None] - ground[None, :, :2]) ** 2).sum(axis=2)
    return np.column_stack([plan, ground[gaps.argmin(axis=1), 2]])
