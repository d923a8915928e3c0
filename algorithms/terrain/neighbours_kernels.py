"""Compiled loops over the neighbours of points in plan, found by the cells that they lie in.

Points stand cell after cell, `starts` says where each cell begins; `lowest` is each cell's least height.
"""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _as_low(points: Array, i: int, first: int, end: int, radius: float, needed: int) -> int:
    """Count the points from `first` to `end` within a radius of point i that lie below its cone, up to `needed`."""
    found = 0
    for j in range(first, end):
        d = math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
        if j != i and d <= radius and points[j, 2] < points[i, 2] + 1.0 + 0.5 * d:
            found += 1
            if found >= needed:
                break
    return found


@njit(cache=True, nogil=True)
def few_as_low(
    points: Array, cells: Array, starts: Array, columns: int, edge: float, radius: float, needed: int
) -> Array:
    """Tell for each point whether fewer than `needed` others within a radius lie below a cone that opens upwards.

    The cone stands 1 m above the point and rises by half of the distance.
    """
    rows = (len(starts) - 1) // columns
    reach = math.ceil(radius / edge)
    few = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        r = cells[i] // columns
        c = cells[i] % columns
        first, last = max(0, c - reach), min(columns, c + reach + 1)
        # the own row first: on open ground it decides
        found = _as_low(points, i, starts[r * columns + first], starts[r * columns + last], radius, needed)
        for rr in range(max(0, r - reach), min(rows, r + reach + 1)):
            if found >= needed:
                break
            if rr != r:
                begin, end = starts[rr * columns + first], starts[rr * columns + last]
                found += _as_low(points, i, begin, end, radius, needed - found)
        few[i] = found < needed
    return few


@njit(cache=True, nogil=True)
def _height_at(allowed: Array, step: float, distance: float) -> float:
    """Interpolate the allowed height at a distance; beyond the end it stays."""
    k = min(int(distance / step), len(allowed) - 2)
    return float(allowed[k] + min(distance / step - k, 1.0) * (allowed[k + 1] - allowed[k]))


@njit(cache=True, nogil=True)
def _is_contradicted(points: Array, i: int, first: int, end: int, allowed: Array, step: float, extra: float) -> bool:
    """Tell whether one of the points from `first` to `end` within reach of point i lies lower than allowed."""
    radius = step * (len(allowed) - 1)
    for j in range(first, end):
        d = math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
        if d <= radius and points[i, 2] > points[j, 2] + _height_at(allowed, step, d) + extra * d:
            return True
    return False


@njit(cache=True, nogil=True)
def under_elements(
    points: Array,
    cells: Array,
    starts: Array,
    lowest: Array,
    columns: int,
    edge: float,
    allowed: Array,
    step: float,
    extra: Array,
    start: int,
    end: int,
) -> Array:
    """Tell for the points from `start` to `end` whether none within reach lies lower than its distance allows.

    Cells whose lowest point could not contradict at the least distance are passed over.

    Parameters
    ----------
    allowed
        Allowed height at distances 0, `step`, 2 `step` …, not falling; linear between. Its end is the radius.
    extra
        (n,) slope that is added to it at each point.
    """
    rows = (len(starts) - 1) // columns
    reach = math.ceil(step * (len(allowed) - 1) / edge)
    out = np.ones(end - start, np.bool_)
    for i in range(start, end):
        r = cells[i] // columns
        c = cells[i] % columns
        for rr in range(max(0, r - reach), min(rows, r + reach + 1)):
            for cc in range(max(0, c - reach), min(columns, c + reach + 1)):
                cell = rr * columns + cc
                least = edge * max(0, max(abs(rr - r), abs(cc - c)) - 1)
                if lowest[cell] + _height_at(allowed, step, least) + extra[i] * least >= points[i, 2]:
                    continue
                if _is_contradicted(points, i, starts[cell], starts[cell + 1], allowed, step, extra[i]):
                    out[i - start] = False
                    break
            if not out[i - start]:
                break
    return out


@njit(cache=True, nogil=True)
def drops_by_distance(
    points: Array,
    cells: Array,
    starts: Array,
    columns: int,
    edge: float,
    step: float,
    steps: int,
    wanted: Array,
    extra: Array,
) -> Array:
    """Give how far points lie above the lowest of the points around, ring by ring, (m, steps) [m]; NaN for none.

    Parameters
    ----------
    step, steps
        Width of a ring [m], and their number; ring k has distances from k to k + 1 steps.
    wanted
        (m,) the points.
    extra
        (n,) slope at each point, times distance taken off its height over the others.
    """
    rows = (len(starts) - 1) // columns
    radius = step * steps
    reach = math.ceil(radius / edge)
    out = np.full((len(wanted), steps), np.nan)
    for m in range(len(wanted)):
        i = wanted[m]
        r = cells[i] // columns
        c = cells[i] % columns
        first, last = max(0, c - reach), min(columns, c + reach + 1)
        for rr in range(max(0, r - reach), min(rows, r + reach + 1)):
            for j in range(starts[rr * columns + first], starts[rr * columns + last]):
                d = math.hypot(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
                k = int(d / step)
                drop = points[i, 2] - points[j, 2] - extra[i] * d
                if j != i and k < steps and not out[m, k] >= drop:
                    out[m, k] = drop
    return out
