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
def _note_near_lines(
    k: int, points: Array, owners: Array, reach: float, known: int, grid: tuple[Array, Array, Array], last: Array
) -> int:
    """Write the lines near point k that no earlier point of its line was near to `last[:, 1]`; give how many.

    `last[:, 0]` holds for each line the line to which it was last found near. Of the lines from `known` on only those
    after the point's own count.
    """
    places, members, starts = grid
    i, row, column = owners[k], places[k, 0], places[k, 1]
    found = 0
    for r in range(max(0, row - 1), min(len(starts), row + 2)):
        for at in range(starts[r, max(0, column - 1)], starts[r, min(starts.shape[1] - 1, column + 2)]):
            j = owners[members[at]]
            if (known <= j <= i) or last[j, 0] == i:
                continue
            x, y = points[members[at], 0] - points[k, 0], points[members[at], 1] - points[k, 1]
            if x * x + y * y <= reach * reach:
                last[j, 0] = i
                last[found, 1] = j
                found += 1
    return found


@njit(cache=True, nogil=True)
def near_lines(points: Array, owners: Array, reach: float, known: int) -> Array:
    """Give pairs (i, j), i < j, of lines of which some points are at most `reach` apart, each once, (p, 2).

    Parameters
    ----------
    points
        (m, 2) points of the lines, one line after the other.
    owners
        (m,) line of each.
    reach
        Largest distance [px].
    known
        Pairs among the first `known` lines are left out.
    """
    extent = max(points[:, 0].max() - points[:, 0].min(), points[:, 1].max() - points[:, 1].min())
    grid = _sorted_into_cells(points, max(reach, extent / MOST_CELLS_A_SIDE))
    out = np.empty((max(16, len(points)), 2), dtype=np.int64)
    count = 0
    last = np.full((owners.max() + 1, 2), -1, dtype=np.int64)
    for k in range(np.searchsorted(owners, known), len(points)):
        found = _note_near_lines(k, points, owners, reach, known, grid, last)
        if count + found > len(out):
            out = np.concatenate((out, np.empty((len(out) + found, 2), dtype=np.int64)))
        for f in range(found):
            i, j = owners[k], last[f, 1]
            out[count, 0], out[count, 1] = min(i, j), max(i, j)
            count += 1
    return out[:count]
