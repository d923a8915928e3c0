"""Compiled loop of the noise of ranges: by how much neighbours on a vertical circle contradict each other."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def contradictions(ranges: Array, flattest_step: float) -> Array:
    """Give by how much the middle one of three ranges differs from what the outer ones let expect [m].

    Of each column the triplets are used whose outer ranges differ by less than a share of the middle one.
    """
    rows, columns = ranges.shape
    out = np.empty(max(rows - 2, 0) * columns)
    found = 0
    for i in range(1, rows - 1):
        for j in range(columns):
            before = np.float64(ranges[i - 1, j])
            own = np.float64(ranges[i, j])
            after = np.float64(ranges[i + 1, j])
            if before > 0.0 and own > 0.0 and after > 0.0 and abs(after - before) < flattest_step * own:
                out[found] = abs(own - 2.0 / (1.0 / before + 1.0 / after))
                found += 1
    return out[:found]
