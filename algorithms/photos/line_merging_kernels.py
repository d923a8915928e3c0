"""Compiled search for lines beside each other."""

import numpy as np
from numba import njit

from algorithms.arrays import Array

MOST_CELLS_A_SIDE = 2048
"""Points far apart share larger cells: the grid stays small."""


@njit(cache=True, nogil=True)
def near_lines(points: Array, starts: Array, reach: float) -> Array:
    """Give pairs (i, j), i < j, of lines of which some points are at most `reach` apart, each once, (p, 2).

    Parameters
    ----------
    points
        (m, 2) points of the lines, one line after the other.
    starts
        (n + 1,) where the points of each line begin, and their number.
    reach
        Largest distance [px].
    """
    low_x, low_y = points[:, 0].min(), points[:, 1].min()
    width, height = points[:, 0].max() - low_x, points[:, 1].max() - low_y
    cell = max(reach, max(width, height) / MOST_CELLS_A_SIDE)
    columns, rows = int(width / cell) + 1, int(height / cell) + 1
    place = np.empty((len(points), 2), dtype=np.int32)
    first = np.zeros(rows * columns + 1, dtype=np.int64)
    for k in range(len(points)):
        place[k, 0], place[k, 1] = int((points[k, 1] - low_y) / cell), int((points[k, 0] - low_x) / cell)
        first[place[k, 0] * columns + place[k, 1] + 1] += 1
    for k in range(rows * columns):
        first[k + 1] += first[k]
    owners = np.empty(len(points), dtype=np.int64)
    members = np.empty(len(points), dtype=np.int64)
    filled = first[:-1].copy()
    for i in range(len(starts) - 1):
        for k in range(starts[i], starts[i + 1]):
            owners[k] = i
            at = place[k, 0] * columns + place[k, 1]
            members[filled[at]] = k
            filled[at] += 1
    out = np.empty((max(16, 4 * len(starts)), 2), dtype=np.int64)
    found = 0
    last = np.full(len(starts), -1, dtype=np.int64)  # the line to which each was last found near
    for i in range(len(starts) - 1):
        for k in range(starts[i], starts[i + 1]):
            left, right = max(0, place[k, 1] - 1), min(columns, place[k, 1] + 2)
            for row in range(max(0, place[k, 0] - 1), min(rows, place[k, 0] + 2)):
                for at in range(first[row * columns + left], first[row * columns + right]):
                    j = owners[members[at]]
                    if j <= i or last[j] == i:
                        continue
                    x, y = points[members[at], 0] - points[k, 0], points[members[at], 1] - points[k, 1]
                    if x * x + y * y > reach * reach:
                        continue
                    last[j] = i
                    if found == len(out):
                        larger = np.empty((2 * found, 2), dtype=np.int64)
                        larger[:found] = out
                        out = larger
                    out[found, 0], out[found, 1] = i, j
                    found += 1
    return out[:found]
