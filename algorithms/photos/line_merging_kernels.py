"""Compiled search for lines beside each other."""

import numpy as np
from numba import njit

from algorithms.arrays import Array

MOST_CELLS_A_SIDE = 2048
"""Points far apart share larger cells: the grid stays small."""


@njit(cache=True, nogil=True)
def _sorted_into_cells(points: Array, cell: float) -> tuple[Array, Array, Array]:
    """Give row and column of each point (m, 2), the points cell by cell, and where each cell begins (rows, columns)."""
    low_x, low_y = points[:, 0].min(), points[:, 1].min()
    places = np.empty((len(points), 2), dtype=np.int64)
    for k in range(len(points)):
        places[k, 0], places[k, 1] = int((points[k, 1] - low_y) / cell), int((points[k, 0] - low_x) / cell)
    # one column more: the end of a row's last cell is the start of the next row
    starts = np.zeros((places[:, 0].max() + 1, places[:, 1].max() + 2), dtype=np.int64)
    for k in range(len(points)):
        starts[places[k, 0], places[k, 1] + 1] += 1
    flat = starts.reshape(-1)
    for k in range(1, len(flat)):
        flat[k] += flat[k - 1]
    members = np.empty(len(points), dtype=np.int64)
    filled = starts.copy()
    for k in range(len(points)):
        members[filled[places[k, 0], places[k, 1]]] = k
        filled[places[k, 0], places[k, 1]] += 1
    return places, members, starts


@njit(cache=True, nogil=True)
def _near_points(i: int, k: int, points: Array, owners: Array, reach: float, grid: tuple[Array, Array, Array]) -> Array:
    """Give the lines after line i of which a point is at most `reach` from point k, with repetitions."""
    places, members, starts = grid
    row, column = places[k, 0], places[k, 1]
    out = np.empty(0, dtype=np.int64)
    found = 0
    for r in range(max(0, row - 1), min(len(starts), row + 2)):
        first = starts[r, max(0, column - 1)]
        last = starts[r, min(starts.shape[1] - 1, column + 2)]
        for at in range(first, last):
            j = owners[members[at]]
            if j > i:
                x, y = points[members[at], 0] - points[k, 0], points[members[at], 1] - points[k, 1]
                if x * x + y * y <= reach * reach:
                    if found == len(out):
                        out = np.concatenate((out, np.empty(max(4, found), dtype=np.int64)))
                    out[found] = j
                    found += 1
    return out[:found]


@njit(cache=True, nogil=True)
def near_lines(points: Array, owners: Array, reach: float) -> Array:
    """Give pairs (i, j), i < j, of lines of which some points are at most `reach` apart, each once, (p, 2).

    Parameters
    ----------
    points
        (m, 2) points of the lines, one line after the other.
    owners
        (m,) line of each.
    reach
        Largest distance [px].
    """
    extent = max(points[:, 0].max() - points[:, 0].min(), points[:, 1].max() - points[:, 1].min())
    grid = _sorted_into_cells(points, max(reach, extent / MOST_CELLS_A_SIDE))
    out = np.empty((max(16, len(points)), 2), dtype=np.int64)
    found = 0
    seen_by = np.full(owners.max() + 1, -1, dtype=np.int64)
    for k in range(len(points)):
        i = owners[k]
        for j in _near_points(i, k, points, owners, reach, grid):
            if seen_by[j] == i:
                continue
            seen_by[j] = i
            if found == len(out):
                out = np.concatenate((out, np.empty_like(out)))
            out[found, 0], out[found, 1] = i, j
            found += 1
    return out[:found]
