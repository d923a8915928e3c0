"""Compiled loops that compare pairs of lines with each other."""

from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True)
def _differs(target: Array, t: int, source: Array, s: int) -> Any:  # pragma: no cover - compiled
    """Say whether two rows differ by more than 1 in any entry; the last entries tell most apart."""
    k = target.shape[1] - 1
    while k >= 0 and abs(target[t, k] - source[s, k]) <= 1.0:
        k -= 1
    return k >= 0


@njit(cache=True)
def alike_rows(target: Array, source: Array, first: Array, stop: Array) -> Any:  # pragma: no cover - compiled
    """Find the rows of two tables that differ by no more than 1 in each entry, O(n (stop - first)).

    Parameters
    ----------
    target, source
        (n, k) and (m, k).
    first, stop
        (n,) which rows of the source to compare each row of the target with.

    Returns
    -------
    (matches, 2) row of the target, row of the source, in this order.
    """
    total = 0
    for t in range(len(target)):
        for s in range(first[t], stop[t]):
            if not _differs(target, t, source, s):
                total += 1
    matches = np.empty((total, 2), dtype=np.int64)
    found = 0
    for t in range(len(target)):
        for s in range(first[t], stop[t]):
            if not _differs(target, t, source, s):
                matches[found, 0], matches[found, 1] = t, s
                found += 1
    return matches
