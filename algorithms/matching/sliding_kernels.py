"""Compiled loops that slide one surface along another and count where they meet."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

MOST_CELLS = 2000
"""At most so many cells along each side of the cross-section; larger ones beyond."""
MOST_BINS = 1_000_000
"""At most so many bins along the direction; wider ones beyond."""


@njit(cache=True)
def _facing(
    points: Array, normals: Array, frame: Array, least_cosine: float, most: int
) -> Any:  # pragma: no cover - compiled
    """Take the first points whose normals face along the first row of the frame, with coordinates in it, and sides."""
    places = np.empty((most, 3))
    sides = np.empty(most, dtype=np.bool_)
    count = 0
    for k in range(len(points)):
        cosine = frame[0, 0] * normals[k, 0] + frame[0, 1] * normals[k, 1] + frame[0, 2] * normals[k, 2]
        if abs(cosine) < least_cosine:
            continue
        for a in range(3):
            places[count, a] = frame[a, 0] * points[k, 0] + frame[a, 1] * points[k, 1] + frame[a, 2] * points[k, 2]
        sides[count] = cosine > 0.0
        count += 1
        if count == most:
            break
    return places[:count], sides[:count]


@njit(cache=True)
def _in_cells(places: Array, sides: Array, cell: float) -> Any:  # pragma: no cover - compiled
    """Sort points by their cells across the direction: starts of the cells, places along, sides, corner, shape."""
    low_v, low_w = places[:, 1].min(), places[:, 2].min()
    rows = math.floor((places[:, 1].max() - low_v) / cell) + 1
    columns = math.floor((places[:, 2].max() - low_w) / cell) + 1
    cells = np.empty(len(places), dtype=np.int64)
    starts = np.zeros(rows * columns + 1, dtype=np.int64)
    for k in range(len(places)):
        cells[k] = math.floor((places[k, 1] - low_v) / cell) * columns + math.floor((places[k, 2] - low_w) / cell)
        starts[cells[k] + 1] += 1
    starts = np.cumsum(starts)
    order = np.argsort(cells, kind="mergesort")
    return starts, places[order, 0], sides[order], low_v, low_w, rows, columns


@njit(cache=True)
def _strongest(counts: Array, smooth: Array, places: Array, votes: Array) -> Any:  # pragma: no cover - compiled
    """Write the bins in which most meets, each counted with half of its neighbours and at least three bins apart."""
    bins = len(counts)
    for b in range(bins):
        smooth[b] = counts[b] + 0.5 * (counts[b - 1] if b > 0 else 0.0)
        smooth[b] += 0.5 * (counts[b + 1] if b + 1 < bins else 0.0)
    for p in range(len(votes)):
        b = int(np.argmax(smooth))
        if smooth[b] <= 0.0:
            break
        votes[p], places[p] = smooth[b], b + 0.5
        smooth[max(0, b - 2) : b + 3] = 0.0


@njit(cache=True, nogil=True)
def slide(
    points: Array,
    normals: Array,
    moved_points: Array,
    moved_normals: Array,
    frame: Array,
    moved_frame: Array,
    shifts: Array,
    settings: Array,
    offsets: Array,
    votes: Array,
) -> Any:  # pragma: no cover - compiled
    """Write for each shift how far to move further along the first row of the frame so that most surface meets.

    `frame` has the direction and two unit vectors across it as rows, `moved_frame` the same as seen from the scan that
    is moved, before it is turned; `shifts` (k, 3) are given in it. `settings`: least
    cosine of normals with the direction, most points of each scan, edge of the cells across, width of the bins along.
    `offsets` and `votes` (k, most peaks): the strongest first, no votes where there are no more.
    """
    least_cosine, most, cell, bin_m = settings[0], int(settings[1]), settings[2], settings[3]
    own, own_sides = _facing(points, normals, frame, least_cosine, most)
    moved, moved_sides = _facing(moved_points, moved_normals, moved_frame, least_cosine, most)
    votes[:] = 0.0
    offsets[:] = 0.0
    if len(own) == 0 or len(moved) == 0:
        return
    extent = max(own[:, 1].max() - own[:, 1].min(), own[:, 2].max() - own[:, 2].min())
    cell = max(cell, extent / MOST_CELLS)
    starts, along, sides, low_v, low_w, rows, columns = _in_cells(own, own_sides, cell)
    lowest = own[:, 0].min() - moved[:, 0].max()
    bin_m = max(bin_m, (own[:, 0].max() - moved[:, 0].min() - lowest) / MOST_BINS)
    bins = math.floor((own[:, 0].max() - moved[:, 0].min() - lowest) / bin_m) + 1
    counts, smooth = np.empty(bins), np.empty(bins)
    for h in range(len(shifts)):
        counts[:] = 0.0
        for k in range(len(moved)):
            i = math.floor((moved[k, 1] + shifts[h, 1] - low_v) / cell)
            j = math.floor((moved[k, 2] + shifts[h, 2] - low_w) / cell)
            if 0 <= i < rows and 0 <= j < columns:
                for m in range(starts[i * columns + j], starts[i * columns + j + 1]):
                    if sides[m] == moved_sides[k]:
                        counts[int((along[m] - moved[k, 0] - lowest) / bin_m)] += 1.0
        _strongest(counts, smooth, offsets[h], votes[h])
        offsets[h] = lowest + offsets[h] * bin_m - shifts[h, 0]
