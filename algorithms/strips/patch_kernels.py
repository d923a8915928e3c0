"""Compiled loops over the points of strips: scan lines, and planes through the points about a place.

Points of a strip are found by cells in plan: `order` has the numbers of all points cell after cell, `starts` where each
cell begins.
"""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

FITS, ABSOLUTE = 12, 5
"""Fits of a plane at most; the first of them minimise absolute distances, later ones leave out what is far off."""
FAR = 3.0
"""Points further off than so many standard deviations are left out."""


@njit(cache=True, nogil=True)
def line_numbers(across: Array, hysteresis: float, jump: float) -> Array:
    """Give the number of the scan line (n,) of points in the order of time.

    A line ends where the mirror turns back by more than `hysteresis`, or goes back by more than `jump` at once.
    """
    out = np.zeros(len(across), np.int64)
    if len(across) == 0:
        return out
    line, sense, extreme, at = 0, 0, across[0], 0
    for i in range(1, len(across)):
        step = across[i] - across[i - 1]
        if sense != 0 and step * sense < -jump:
            line += 1
            extreme, at = across[i], i
        elif sense == 0:
            if abs(across[i] - extreme) > hysteresis:
                sense = 1 if across[i] > extreme else -1
                extreme, at = across[i], i
        elif (across[i] - extreme) * sense > 0.0:
            extreme, at = across[i], i
        elif (extreme - across[i]) * sense > hysteresis:
            line += 1
            out[at + 1 : i] = line
            sense = -sense
            extreme, at = across[i], i
        out[i] = line
    return out


@njit(cache=True, nogil=True)
def _members(
    points: Array, order: Array, starts: Array, x0: float, y0: float, edge: float, columns: int, rows: int,
    x: float, y: float, radius: float, found: Array,
) -> int:  # fmt: skip
    """Find the points within a radius in plan; give how many."""
    count = 0
    first, last = max(0, math.floor((x - radius - x0) / edge)), min(columns - 1, math.floor((x + radius - x0) / edge))
    for r in range(
        max(0, math.floor((y - radius - y0) / edge)), min(rows - 1, math.floor((y + radius - y0) / edge)) + 1
    ):
        if last < first:
            break
        for k in range(starts[r * columns + first], starts[r * columns + last + 1]):
            i = order[k]
            if (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 <= radius * radius and count < len(found):
                found[count] = i
                count += 1
    return count


@njit(cache=True, nogil=True)
def _solved(normal: Array, right: Array, size: int) -> bool:
    """Solve symmetric equations in place by Cholesky; give whether they are regular."""
    for j in range(size):
        pivot = normal[j, j]
        for k in range(j):
            pivot -= normal[j, k] ** 2
        if pivot <= 1e-9 * normal[j, j] or pivot <= 0.0:
            return False
        normal[j, j] = math.sqrt(pivot)
        for i in range(j + 1, size):
            total = normal[i, j]
            for k in range(j):
                total -= normal[i, k] * normal[j, k]
            normal[i, j] = total / normal[j, j]
    for j in range(size):
        for k in range(j):
            right[j] -= normal[j, k] * right[k]
        right[j] /= normal[j, j]
    for j in range(size - 1, -1, -1):
        for k in range(j + 1, size):
            right[j] -= normal[k, j] * right[k]
        right[j] /= normal[j, j]
    return True


@njit(cache=True, nogil=True)
def _solved_fit(local: Array, used: Array, weights: Array, size: int, out: Array) -> float:
    """Solve w = c0 + c1 u + c2 v + l s for `out`; give the variance of l over that of a point, below zero if singular.

    `local` has u, v, w, s.
    """
    normal, right, row = np.zeros((4, 4)), np.zeros(4), np.empty(4)
    for k in range(len(local)):
        if not used[k]:
            continue
        row[0], row[1], row[2], row[3] = 1.0, local[k, 0], local[k, 1], local[k, 3]
        for a in range(size):
            right[a] += weights[k] * row[a] * local[k, 2]
            for b in range(a + 1):
                normal[a, b] += weights[k] * row[a] * row[b]
    if not _solved(normal, right, size):
        return -1.0
    out[3] = 0.0
    out[:size] = right[:size]
    return (1.0 / normal[3, 3]) ** 2 if size == 4 else 0.0


@njit(cache=True, nogil=True)
def _within(local: Array, figures: Array, spare: Array, limit: float, used: Array) -> int:
    """Mark points within a limit of the plane, whose distances get into `spare`; give how many."""
    n = 0
    for k in range(len(local)):
        spare[k] = abs(
            local[k, 2] - figures[0] - figures[1] * local[k, 0] - figures[2] * local[k, 1] - figures[3] * local[k, 3]
        )
        used[k] = spare[k] <= limit
        n += used[k]
    return n


@njit(cache=True, nogil=True)
def _described(local: Array, times: Array, used: Array, spare: Array, n: int, size: int, out: Array) -> None:
    """Put standard deviation, means and moments of the points used into `out`."""
    total, out[6], out[7], late = 0.0, 0.0, 0.0, 0.0
    for k in range(len(local)):
        if used[k]:
            total += spare[k] ** 2
            out[6] += local[k, 0] / n
            out[7] += local[k, 1] / n
            late += (times[k] - times[0]) / n
    out[5], out[11] = math.sqrt(total / max(n - size, 1)), late + times[0]
    for k in range(len(local)):
        if used[k]:
            u, v, t = local[k, 0] - out[6], local[k, 1] - out[7], times[k] - out[11]
            out[8] += u * u / n
            out[9] += u * v / n
            out[10] += v * v / n
            out[12] += u * t / n
            out[13] += v * t / n


@njit(cache=True, nogil=True)
def _fit_one(local: Array, times: Array, used: Array, floor: float, out: Array) -> int:
    """Fit w = c0 + c1 u + c2 v + l s robustly to points (n, 4) of u, v, w, s; give how many are used.

    `out` gets c0, c1, c2, l, variance of l over that of a point, standard deviation, mean u, mean v, uu, uv, vv about
    the means, mean time, and tu, tv about the means.
    """
    both = (local[:, 3] > 0.0).sum()
    # both directions of the mirror: else the lag is not told from the height of the plane
    size = 4 if 0.3 * len(local) < both < 0.7 * len(local) else 3
    n, std = len(local), 0.0
    spare, weights = np.zeros(n), np.ones(n)
    used[:] = True
    for step in range(FITS):
        if n < size + 2:
            return 0
        # absolute sums first, which single heaps of points do not bend
        if 0 < step < ABSOLUTE:
            weights[:] = 1.0 / np.maximum(spare, max(std, floor))
        elif step == ABSOLUTE:
            weights[:] = 1.0
        out[4] = _solved_fit(local, used, weights, size, out)
        if out[4] < 0.0:
            return 0
        before = n
        _within(local, out, spare, np.inf, used)
        # standard deviation from the median, of all points
        std = 1.4826 * np.median(spare)
        if step + 1 < ABSOLUTE:
            continue
        n = _within(local, out, spare, FAR * max(std, floor), used)
        if step > ABSOLUTE and n == before:
            break
    _described(local, times, used, spare, n, size, out)
    return n


@njit(cache=True, nogil=True)
def fit_planes(
    points: Array, times: Array, senses: Array, order: Array, starts: Array, x0: float, y0: float, edge: float,
    columns: int, rows: int, places: Array, frames: Array, radii: Array, floor: float, most: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Fit planes robustly to points within radii (k,) about places (k, 3), in frames (k, 3, 3) of columns e1, e2, n.

    Returns
    -------
    Counts (k, 2) of points about and of those in the plane, and figures (k, 14) as `_fit_one` has them.
    """
    k = len(places)
    counts, figures = np.zeros((k, 2), np.int64), np.zeros((k, 14))
    found, local, when = np.empty(most, np.int64), np.empty((most, 4)), np.empty(most)
    used = np.empty(most, np.bool_)
    for i in range(k):
        x, y = places[i, 0], places[i, 1]
        count = _members(points, order, starts, x0, y0, edge, columns, rows, x, y, radii[i], found)
        counts[i, 0] = count
        if count < 6:
            continue
        for m in range(count):
            for a in range(3):
                local[m, a] = 0.0
                for b in range(3):
                    local[m, a] += (points[found[m], b] - places[i, b]) * frames[i, b, a]
            local[m, 3] = 2.0 * senses[found[m]] - 1.0
            when[m] = times[found[m]]
        counts[i, 1] = _fit_one(local[:count], when[:count], used[:count], floor, figures[i])
    return counts, figures
