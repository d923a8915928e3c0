"""Compiled loops of the Canny edge detector."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def classify_directions(gx: Array, gy: Array) -> Array:
    """Sort edge directions into 0 along the rows, 1 rising to the right, 2 along the columns, 3 falling, (h, w)."""
    height, width = gx.shape
    out = np.zeros((height, width), dtype=np.uint8)
    tangent = np.float32(math.tan(math.pi / 8.0))
    for i in range(height):
        for j in range(width):
            x, y = gx[i, j], gy[i, j]
            across, down = abs(x), abs(y)
            if across <= tangent * down or (x == 0.0 and y == 0.0):
                out[i, j] = 0
            elif down < tangent * across:
                out[i, j] = 2
            elif (x > 0.0) == (y > 0.0):
                out[i, j] = 1
            else:
                out[i, j] = 3
    return out


@njit(cache=True, nogil=True)
def thin_edges(strength: Array, classes: Array, least: float) -> Array:
    """Keep strengths of at least `least` that no neighbour across the edge exceeds, (h, w) float32, others 0."""
    height, width = strength.shape
    out = np.zeros((height, width), dtype=np.float32)
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            own = strength[i, j]
            if own < least:
                continue
            direction = classes[i, j]
            if direction == 0:
                before, after = strength[i - 1, j], strength[i + 1, j]
            elif direction == 1:
                before, after = strength[i - 1, j - 1], strength[i + 1, j + 1]
            elif direction == 2:
                before, after = strength[i, j - 1], strength[i, j + 1]
            else:
                before, after = strength[i - 1, j + 1], strength[i + 1, j - 1]
            # of a plateau two pixels wide exactly one stays
            if own > before and own >= after:
                out[i, j] = own
    return out
