"""Compiled loops over the range image of a structured scan."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

TILE = 48
"""Pixels are visited in squares of so many: whether a scan was recorded by rows or by columns, its points are near."""


@njit(cache=True, nogil=True)
def grid_ranges(points: Array, index: Array, sensor: Array, first_row: int, end_row: int, out: Array) -> None:
    """Write the range of the pixels of some rows, (rows, columns) float32, 0 where nothing came back."""
    columns = index.shape[1]
    for top in range(first_row, end_row, TILE):
        for left in range(0, columns, TILE):
            for i in range(top, min(top + TILE, end_row)):
                for j in range(left, min(left + TILE, columns)):
                    p = index[i, j]
                    if p < 0:
                        out[i, j] = 0.0
                        continue
                    x = points[p, 0] - sensor[0]
                    y = points[p, 1] - sensor[1]
                    z = points[p, 2] - sensor[2]
                    out[i, j] = math.sqrt(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def neighbour_tangents(points: Array, index: Array, sensor: Array, line: int) -> Array:
    """Give the tangents of the angles between neighbours along one row of the grid, inf from a right angle on."""
    out = np.empty(index.shape[1])
    found = 0
    for j in range(1, index.shape[1]):
        a = index[line, j - 1]
        b = index[line, j]
        if a < 0 or b < 0:
            continue
        ux, uy, uz = points[a, 0] - sensor[0], points[a, 1] - sensor[1], points[a, 2] - sensor[2]
        vx, vy, vz = points[b, 0] - sensor[0], points[b, 1] - sensor[1], points[b, 2] - sensor[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        dot = ux * vx + uy * vy + uz * vz
        out[found] = math.sqrt(x * x + y * y + z * z) / dot if dot > 0.0 else np.inf
        found += 1
    return out[:found]


@njit(cache=True, nogil=True)
def _torn(before2: float, before: float, own: float, after: float, after2: float, limit: float) -> bool:
    """Tell whether a range hangs between two depths (or sticks out of both sides) rather than on a steep surface."""
    if before <= 0.0 or after <= 0.0:
        return False
    back = own - before
    ahead = after - own
    if abs(back) < limit or abs(ahead) < limit:
        return False
    if back * ahead < 0.0:
        return True
    # a steep surface continues with jumps of the same size; the sides of a mixed pixel do not
    return (before2 <= 0.0 or abs(before - before2) < 0.5 * abs(back)) and (
        after2 <= 0.0 or abs(after2 - after) < 0.5 * abs(ahead)
    )


@njit(cache=True, nogil=True)
def torn_pixels(
    ranges: Array, step_rad: float, slope: float, least_jump: float, first_row: int, end_row: int, out: Array
) -> None:
    """Mark pixels of some rows whose range jumps to both neighbours of its row or of its column, in `out`."""
    rows, columns = ranges.shape
    for i in range(first_row, end_row):
        for j in range(columns):
            out[i, j] = False
            own = ranges[i, j]
            if own <= 0.0:
                continue
            limit = slope * own * step_rad + least_jump
            # most pixels lie on a surface, which one neighbour shows already
            if 0 < j < columns - 1 and abs(own - ranges[i, j - 1]) >= limit:
                before2 = ranges[i, j - 2] if j > 1 else 0.0
                after2 = ranges[i, j + 2] if j < columns - 2 else 0.0
                out[i, j] = _torn(before2, ranges[i, j - 1], own, ranges[i, j + 1], after2, limit)
            if 0 < i < rows - 1 and not out[i, j] and abs(own - ranges[i - 1, j]) >= limit:
                before2 = ranges[i - 2, j] if i > 1 else 0.0
                after2 = ranges[i + 2, j] if i < rows - 2 else 0.0
                out[i, j] = _torn(before2, ranges[i - 1, j], own, ranges[i + 1, j], after2, limit)
