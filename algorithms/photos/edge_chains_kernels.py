"""Compiled loops that link edge pixels and cut the chains into straight pieces."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

NEXT_TURN = 0.35
"""Least cosine between the edge's direction and the step to its next pixel."""
SAME_GRADIENT = 0.7
"""Least cosine between the gradients of pixels that follow each other."""
MISSES = 3
"""So many pixels off the line in a row end a straight piece."""


@njit(cache=True, nogil=True)
def _next_pixel(free: Array, gx: Array, gy: Array, i: int, j: int, sense: float) -> tuple[int, int]:
    """Find the unused edge pixel that continues the edge at (i, j), (-1, -1) if none does; gaps of one are jumped."""
    height, width = free.shape
    x, y = gx[i, j], gy[i, j]
    size = math.sqrt(x * x + y * y)
    dx, dy = sense * y / size, -sense * x / size
    for reach in range(1, 3):
        best, best_i, best_j = 0.0, -1, -1
        for a in range(max(0, i - reach), min(height, i + reach + 1)):
            for b in range(max(0, j - reach), min(width, j + reach + 1)):
                if not free[a, b]:
                    continue
                di, dj = a - i, b - j
                cosine = (dj * dx + di * dy) / math.sqrt(di * di + dj * dj)
                if cosine < NEXT_TURN:
                    continue
                u, v = gx[a, b], gy[a, b]
                alike = (u * x + v * y) / (size * math.sqrt(u * u + v * v))
                if alike > SAME_GRADIENT and cosine + alike > best:
                    best, best_i, best_j = cosine + alike, a, b
        if best_i >= 0:
            return best_i, best_j
    return -1, -1


@njit(cache=True, nogil=True)
def link_pixels(  # noqa: C901 - one compiled loop
    edges: Array, gx: Array, gy: Array, least: int
) -> tuple[Array, Array, Array]:
    """Link edge pixels to chains of at least `least`: rows and columns one chain after the other, and the splits."""
    height, width = edges.shape
    free = edges.copy()
    total = 0
    for i in range(height):
        for j in range(width):
            if free[i, j]:
                total += 1
                if gx[i, j] == 0.0 and gy[i, j] == 0.0:
                    free[i, j] = False
    rows = np.empty(total, dtype=np.int32)
    columns = np.empty(total, dtype=np.int32)
    splits = np.zeros(total // max(1, least) + 2, dtype=np.int64)
    used = 0
    chains = 0
    for i in range(height):
        for j in range(width):
            if not free[i, j]:
                continue
            start = used
            free[i, j] = False
            # first against the direction, then turned round, then along it
            a, b = i, j
            while a >= 0:
                rows[used], columns[used] = a, b
                used += 1
                free[a, b] = False
                a, b = _next_pixel(free, gx, gy, a, b, -1.0)
            rows[start:used] = rows[start:used][::-1].copy()
            columns[start:used] = columns[start:used][::-1].copy()
            a, b = _next_pixel(free, gx, gy, i, j, 1.0)
            while a >= 0:
                rows[used], columns[used] = a, b
                used += 1
                free[a, b] = False
                a, b = _next_pixel(free, gx, gy, a, b, 1.0)
            if used - start < least:
                used = start
            else:
                chains += 1
                splits[chains] = used
    return rows[:used], columns[:used], splits[: chains + 1]


@njit(cache=True, nogil=True)
def _strength(gx: Array, gy: Array, i: int, j: int) -> float:
    return math.sqrt(gx[i, j] * gx[i, j] + gy[i, j] * gy[i, j])


@njit(cache=True, nogil=True)
def peak_positions(rows: Array, columns: Array, gx: Array, gy: Array) -> Array:
    """Place every edge pixel at the top of the parabola through the gradients beside it, (n, 2) columns and rows."""
    height, width = gx.shape
    out = np.empty((len(rows), 2))
    for k in range(len(rows)):
        i, j = rows[k], columns[k]
        out[k, 0], out[k, 1] = j, i
        along_row = abs(gx[i, j]) > abs(gy[i, j])
        if along_row and 0 < j < width - 1:
            before, after = _strength(gx, gy, i, j - 1), _strength(gx, gy, i, j + 1)
        elif not along_row and 0 < i < height - 1:
            before, after = _strength(gx, gy, i - 1, j), _strength(gx, gy, i + 1, j)
        else:
            continue
        bend = before - 2.0 * _strength(gx, gy, i, j) + after
        if bend < 0.0:
            shift = min(0.7, max(-0.7, 0.5 * (before - after) / bend))
            out[k, 0 if along_row else 1] += shift
    return out


@njit(cache=True, nogil=True)
def _line(sums: Array) -> tuple[float, float, float, float]:
    """Give centroid and direction of the total least squares line from (n, Σx, Σy, Σxx, Σxy, Σyy)."""
    n = sums[0]
    mx, my = sums[1] / n, sums[2] / n
    xx, xy, yy = sums[3] / n - mx * mx, sums[4] / n - mx * my, sums[5] / n - my * my
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    return mx, my, math.cos(angle), math.sin(angle)


@njit(cache=True, nogil=True)
def _add(sums: Array, x: float, y: float) -> None:
    sums[0] += 1.0
    sums[1] += x
    sums[2] += y
    sums[3] += x * x
    sums[4] += x * y
    sums[5] += y * y


@njit(cache=True, nogil=True)
def cut_chains(points: Array, splits: Array, window: int, tolerance: float) -> Array:
    """Cut chains of points into straight pieces, (n, 4) with x, y of both ends.

    A piece starts where `window` points in a row fit a line to half of `tolerance` (rms) and grows, the line fitted
    anew with every point, until `MISSES` points in a row are further off than `tolerance` [px].
    """
    out = np.empty((len(points) // window + 1, 4))
    found = 0
    sums = np.zeros(6)
    for c in range(len(splits) - 1):
        start, end = splits[c], splits[c + 1]
        while start + window <= end:
            ox, oy = points[start, 0], points[start, 1]
            sums[:] = 0.0
            for k in range(start, start + window):
                _add(sums, points[k, 0] - ox, points[k, 1] - oy)
            mx, my, dx, dy = _line(sums)
            square = 0.0
            for k in range(start, start + window):
                across = (points[k, 1] - oy - my) * dx - (points[k, 0] - ox - mx) * dy
                square += across * across
            if square > window * 0.25 * tolerance * tolerance:
                start += 2
                continue
            last = start + window - 1
            k, missed = last + 1, 0
            while k < end and missed < MISSES:
                x, y = points[k, 0] - ox, points[k, 1] - oy
                if abs((y - my) * dx - (x - mx) * dy) <= tolerance:
                    _add(sums, x, y)
                    mx, my, dx, dy = _line(sums)
                    last, missed = k, 0
                else:
                    missed += 1
                k += 1
            first_along = (points[start, 0] - ox - mx) * dx + (points[start, 1] - oy - my) * dy
            last_along = (points[last, 0] - ox - mx) * dx + (points[last, 1] - oy - my) * dy
            out[found, 0], out[found, 1] = ox + mx + first_along * dx, oy + my + first_along * dy
            out[found, 2], out[found, 3] = ox + mx + last_along * dx, oy + my + last_along * dy
            found += 1
            start = last + 1
    return out[:found]
