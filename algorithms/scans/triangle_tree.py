"""Rays and points against triangles: first hits, occlusion, crossings, nearest triangles."""

import numpy as np

from algorithms.arrays import Array, Flags, Indices
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.triangle_tree_kernels import (
    build_tree,
    crossed_triangles,
    first_hits,
    meets_any,
    nearest_triangles,
)

LEAST_RAYS = 1 << 12
"""Fewer rays are not worth a thread of their own."""


class TriangleTree:
    """Boxes about boxes about triangles, all in double precision.

    Coordinates are counted from the middle of the triangles, so that a far origin costs no digits. Each answer follows
    from its ray or point alone: threads change nothing.
    """

    def __init__(self, vertices: Array, triangles: Array) -> None:
        """Build the tree over triangles (t, 3) of vertices (v, 3) [m]; O(t log t)."""
        count = len(triangles)
        used = vertices[triangles]
        low, high = used.reshape(-1, 3).min(axis=0), used.reshape(-1, 3).max(axis=0)
        self._centre = np.asarray(0.5 * (low + high))
        corners = np.ascontiguousarray(used - self._centre)
        order = np.arange(count, dtype=np.int64)
        boxes, links = np.empty((2 * count, 6)), np.empty((2 * count, 2), dtype=np.int64)
        nodes = build_tree(corners, order, boxes, links)
        sides = np.ascontiguousarray(
            np.hstack([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]])[order]
        )
        self._tree = (boxes[:nodes].copy(), links[:nodes].copy(), sides, order)

    def first_hits(self, origins: Array, directions: Array) -> Indices:
        """Return the triangle (n,) that each ray meets first, -1 for none.

        Parameters
        ----------
        origins
            (n, 3), or (3,) common to all rays [m]; what lies at an origin itself is not met.
        directions
            (n, 3) of any length.
        """
        found = np.empty(len(directions), dtype=np.int64)
        rays = self._local(origins), _rows(directions)
        over_blocks(lambda start, end: first_hits(self._tree, *rays, start, end, found), len(found), least=LEAST_RAYS)
        return found

    def meets_any(self, origins: Array, directions: Array, near: float = 0.0, far: float = np.inf) -> Flags:
        """Check which rays meet any triangle from `near` to `far`, in lengths of the directions.

        Parameters
        ----------
        origins
            (n, 3) [m].
        directions
            (n, 3) of any length, or (3,) common to all rays.
        near, far
            First and last place along a ray that counts.
        """
        found = np.empty(len(origins), dtype=np.bool_)
        rays = self._local(origins), _rows(directions)
        over_blocks(
            lambda start, end: meets_any(self._tree, *rays, float(near), float(far), start, end, found),
            len(found),
            least=LEAST_RAYS,
        )
        return found

    def crossings(self, starts: Array, ends: Array) -> tuple[Indices, Indices]:
        """Return all crossings of segments (n, 3) to (n, 3) with triangles: segments (m,) and triangles (m,)."""
        counts = np.zeros(len(starts) + 1, dtype=np.int64)
        rays = self._local(starts), _rows(ends - starts)

        def count(start: int, end: int) -> None:
            crossed_triangles(self._tree, *rays, start, end, counts, np.empty(0, dtype=np.int64))

        over_blocks(count, len(starts), least=LEAST_RAYS)
        places = np.cumsum(counts)
        found = np.empty(places[-1], dtype=np.int64)
        if len(found):
            over_blocks(
                lambda start, end: crossed_triangles(self._tree, *rays, start, end, places, found),
                len(starts),
                least=LEAST_RAYS,
            )
        return np.repeat(np.arange(len(starts)), counts[1:]), found

    def nearest(self, points: Array) -> Indices:
        """Return the triangle (n,) nearest to each point (n, 3) [m]."""
        found = np.empty(len(points), dtype=np.int64)
        local = self._local(points)
        over_blocks(
            lambda start, end: nearest_triangles(self._tree, local, start, end, found), len(found), least=LEAST_RAYS
        )
        return found

    def _local(self, places: Array) -> Array:
        return _rows(places - self._centre)


def _rows(vectors: Array) -> Array:
    # kernels are compiled for arrays that may be written to
    return np.require(np.atleast_2d(vectors), np.float64, ["C", "W"])
