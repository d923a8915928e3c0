"""Compiled loop that tells what lies in a ring."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def inside_ring(points: Array, ring: Array) -> Array:
    """Count the crossings of a ray along x with the sides of a ring."""
    out = np.zeros(points.shape[0], dtype=np.bool_)
    low_x, high_x = ring[:, 0].min(), ring[:, 0].max()
    low_y, high_y = ring[:, 1].min(), ring[:, 1].max()
    corners = ring.shape[0]
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        if x < low_x or x > high_x or y < low_y or y > high_y:
            continue
        inside = False
        for a in range(corners):
            b = (a + 1) % corners
            ya, yb = ring[a, 1], ring[b, 1]
            if (ya > y) != (yb > y) and x < ring[a, 0] + (y - ya) * (ring[b, 0] - ring[a, 0]) / (yb - ya):
                inside = not inside
        out[k] = inside
    return out
