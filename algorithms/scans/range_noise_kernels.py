"""Compiled loop of the noise of ranges: by how much neighbours on a vertical circle contradict each other."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def contradictions(ranges: Array, step: int, flattest_step: float) -> Array:
    """Give by how much the middle one of three ranges differs from what the outer ones let expect [m].

    Every `step`-th column is used, and of it the triplets whose outer ranges differ by less than a share of the middle.
    """
    rows, columns = ranges.shape
    out = np.empty(max(rows - 2, 0) * ((columns + step - 1) // step))
    found = 0
    for i in range(1, rows - 1):
        for j in range(0, columns, step):
            before = np.float64(ranges[i - 1, j])
            own = np.float64(ranges[i, j])
            after = np.float64(ranges[i + 1, j])
            if before > 0.0 and own > 0.0 and after > 0.0 and abs(after - before) < flattest_step * own:
                out[found] = abs(own - 2.0 / (1.0 / before + 1.0 / after))
                found += 1
    return out[:found]
