"""Compiled loop that adds cells by groups."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def summed_moments(moments: Array, labels: Array, count: int, cap: float, start: int, end: int) -> Array:
    """Add the cells from `start` to `end` of every group, each with at most `cap` of its points.

    Returns count, mean and central sums of products, all zero for groups without a cell. With a cap of 0 every cell
    counts once, whatever its points.
    """
    origins = np.zeros((count, 3))
    out = np.zeros((count, 10))
    for cell in range(start, end):
        p = labels[cell]
        if p < 0:
            continue
        if out[p, 0] == 0.0:  # the first cell's mean is near enough to the group's to keep the digits
            for a in range(3):
                origins[p, a] = moments[cell, 1 + a]
        w = min(moments[cell, 0], cap) if cap > 0.0 else 1.0
        f = w / moments[cell, 0] if cap > 0.0 else 1.0
        x = moments[cell, 1] - origins[p, 0]
        y = moments[cell, 2] - origins[p, 1]
        z = moments[cell, 3] - origins[p, 2]
        out[p, 0] += w
        out[p, 1] += w * x
        out[p, 2] += w * y
        out[p, 3] += w * z
        out[p, 4] += f * moments[cell, 4] + w * x * x
        out[p, 5] += f * moments[cell, 5] + w * x * y
        out[p, 6] += f * moments[cell, 6] + w * x * z
        out[p, 7] += f * moments[cell, 7] + w * y * y
        out[p, 8] += f * moments[cell, 8] + w * y * z
        out[p, 9] += f * moments[cell, 9] + w * z * z
    for p in range(count):
        n = out[p, 0]
        if n == 0.0:
            continue
        x = out[p, 1] / n
        y = out[p, 2] / n
        z = out[p, 3] / n
        out[p, 4] -= n * x * x
        out[p, 5] -= n * x * y
        out[p, 6] -= n * x * z
        out[p, 7] -= n * y * y
        out[p, 8] -= n * y * z
        out[p, 9] -= n * z * z
        out[p, 1] = x + origins[p, 0]
        out[p, 2] = y + origins[p, 1]
        out[p, 3] = z + origins[p, 2]
    return out
