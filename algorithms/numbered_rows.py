"""Equal rows of integers, such as the cells in which points lie, get one number."""

import numpy as np
from jaxtyping import Int64

from algorithms.arrays import Array, Indices

LARGEST_NUMBER = 1 << 62
"""Ranges of columns are multiplied to one number of a row as far as that goes."""


def numbered_rows(rows: Int64[Array, "n k"]) -> tuple[Int64[Array, "m k"], Indices]:
    """Give the different rows in ascending order, and which of them each row is: `numpy.unique` along the first axis.

    A number of each row is sorted in place of the row, in a tenth of the time. O(n log n).

    Parameters
    ----------
    rows
        (n, k) integers.

    Returns
    -------
    The (m, k) different rows, and (n,) the number of each.
    """
    if len(rows) == 0:
        return rows, np.empty(0, dtype=np.int64)
    whole, count = np.zeros(len(rows), dtype=np.int64), 1
    for column in rows.T:
        low, high = int(column.min()), int(column.max())
        if count * (high - low + 1) >= LARGEST_NUMBER:
            whole, count = _ranked(whole)
            column, width = _ranked(column)  # noqa: PLW2901 - the same column in smaller numbers
        else:
            column, width = column - low, high - low + 1  # noqa: PLW2901
        whole, count = whole * width + column, count * width
    numbers, of_row = np.unique(whole, return_inverse=True)
    different = np.empty((len(numbers), rows.shape[1]), dtype=np.int64)
    different[of_row] = rows
    return different, of_row


def _ranked(values: Indices) -> tuple[Indices, int]:
    """Rank values by size; give how many different ones there are too."""
    different, ranks = np.unique(values, return_inverse=True)
    return ranks, len(different)
