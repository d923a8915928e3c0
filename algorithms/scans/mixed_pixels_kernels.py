"""Compiled loops over the range image of a structured scan."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def grid_ranges(points: Array, index: Array, sensor: Array) -> Array:
    """Give the range of every grid pixel, (rows, columns) float32, 0 where nothing came back."""
    rows, columns = index.shape
    out = np.zeros((rows, columns), dtype=np.float32)
    for i in range(rows):
        for j in range(columns):
            p = index[i, j]
            if p >= 0:
                x = points[p, 0] - sensor[0]
                y = points[p, 1] - sensor[1]
                z = points[p, 2] - sensor[2]
                out[i, j] = math.sqrt(x * x + y * y + z * z)
    return out


@njit(cache=True, nogil=True)
def _torn(before2: float, before: float, own: float, after: float, after2: float, limit: float) -> bool:
    """Tell whether a range hangs between two depths (or sticks out of both sides) rather than on a steep surface."""
    if before <= 0.0 or after <= 0.0:
        return False
    back = own - before
    ahead = after - own
    if abs(back) < limit or abs(ahead) < limit:
        return False
    if back * ahead < 0.0:
        return True
    # a steep surface continues with jumps of the same size; the sides of a mixed pixel do not
    return (before2 <= 0.0 or abs(before - before2) < 0.5 * abs(back)) and (
        after2 <= 0.0 or abs(after2 - after) < 0.5 * abs(ahead)
    )


@njit(cache=True, nogil=True)
def torn_pixels(ranges: Array, step_rad: float, slope: float, least_jump: float) -> Array:
    """Mark pixels whose range jumps to both neighbours of its row or of its column, (rows, columns) bool."""
    rows, columns = ranges.shape
    out = np.zeros((rows, columns), dtype=np.bool_)
    for i in range(rows):
        for j in range(columns):
            own = ranges[i, j]
            if own <= 0.0:
                continue
            limit = slope * own * step_rad + least_jump
            if 0 < j < columns - 1:
                before2 = ranges[i, j - 2] if j > 1 else 0.0
                after2 = ranges[i, j + 2] if j < columns - 2 else 0.0
                out[i, j] = _torn(before2, ranges[i, j - 1], own, ranges[i, j + 1], after2, limit)
            if 0 < i < rows - 1 and not out[i, j]:
                before2 = ranges[i - 2, j] if i > 1 else 0.0
                after2 = ranges[i + 2, j] if i < rows - 2 else 0.0
                out[i, j] = _torn(before2, ranges[i - 1, j], own, ranges[i + 1, j], after2, limit)
    return out
