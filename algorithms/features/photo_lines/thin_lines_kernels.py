"""Compiled loop that finds which edges are both sides of one thin line."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

OPPOSITE_COSINE = -math.cos(math.radians(2.0))
"""Cosine of the directions of both sides: each has the brighter side on its own outside, or on its own inside."""
COMMON_SHARE = 0.7
"""Both run beside each other along so much of the longer one at least."""


@njit(cache=True, nogil=True)
def other_sides(
    centres: Array, directions: Array, extents: Array, contrasts: Array, widest_px: float, largest_ratio: float
) -> Array:
    """Give for each edge (n,) the nearest one that is the other side of a thin line, mutually; -1 where none is.

    The sides run against each other no further apart than `widest_px`, with contrasts up to `largest_ratio` apart.
    """
    n = centres.shape[0]
    nearest = np.full(n, -1, dtype=np.int64)
    for k in range(n):
        dx, dy = directions[k, 0], directions[k, 1]
        low, high = extents[k, 0], extents[k, 1]
        least = widest_px
        for j in range(n):
            if j == k or dx * directions[j, 0] + dy * directions[j, 1] > OPPOSITE_COSINE:
                continue
            x, y = centres[j, 0] - centres[k, 0], centres[j, 1] - centres[k, 1]
            if abs(y * dx - x * dy) > 2.0 * widest_px + high - low:
                continue
            if max(contrasts[j], contrasts[k]) > largest_ratio * min(contrasts[j], contrasts[k]):
                continue
            ax, ay = x + extents[j, 0] * directions[j, 0], y + extents[j, 0] * directions[j, 1]
            bx, by = x + extents[j, 1] * directions[j, 0], y + extents[j, 1] * directions[j, 1]
            sa, sb = ax * dx + ay * dy, bx * dx + by * dy
            start, end = max(low, min(sa, sb)), min(high, max(sa, sb))
            if end - start < COMMON_SHARE * max(high - low, abs(sb - sa)):
                continue
            da, db = ay * dx - ax * dy, by * dx - bx * dy
            at_start = da + (db - da) * (start - sa) / (sb - sa)
            at_end = da + (db - da) * (end - sa) / (sb - sa)
            apart = max(abs(at_start), abs(at_end))
            if at_start * at_end > 0.0 and apart <= least:
                least = apart
                nearest[k] = j
    for k in range(n):
        if nearest[k] >= 0 and nearest[nearest[k]] != k:
            nearest[k] = -2
    return np.where(nearest < 0, -1, nearest)
