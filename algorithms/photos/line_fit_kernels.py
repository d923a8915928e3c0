"""Compiled loops over the edge points of lines."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def group_medians(values: Array, owners: Array, flags: Array, count: int) -> Array:
    """Give the median of the flagged values of each group, (count,), 0 where there are none; owners do not fall."""
    out = np.zeros(count)
    start = 0
    for owner in range(count):
        end = start
        while end < len(owners) and owners[end] == owner:
            end += 1
        chosen = values[start:end][flags[start:end]]
        if len(chosen) > 0:
            out[owner] = np.median(chosen)
        start = end
    return out
