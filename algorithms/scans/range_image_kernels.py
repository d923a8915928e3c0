"""Compiled loops of the spherical range image."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True)
def fill(
    points: Array, sensor: Array, cell_rad: float, splat_m: float, nearest: Array, farthest: Array
) -> Any:  # pragma: no cover - compiled
    """Enter every point with its range; a point covers the cells within `splat_m` of it across the ray."""
    rows, columns = nearest.shape
    for k in range(points.shape[0]):
        x = points[k, 0] - sensor[0]
        y = points[k, 1] - sensor[1]
        z = points[k, 2] - sensor[2]
        r = math.sqrt(x * x + y * y + z * z)
        if r < 1e-6:
            continue
        zenith = math.acos(min(1.0, max(-1.0, z / r)))
        azimuth = math.atan2(y, x) + math.pi
        row = min(rows - 1, int(zenith / cell_rad))
        column = min(columns - 1, int(azimuth / cell_rad))
        value = np.float32(r)
        if splat_m <= 0.0:
            nearest[row, column] = min(nearest[row, column], value)
            farthest[row, column] = max(farthest[row, column], value)
            continue
        reach = min(splat_m / r, 0.2)
        for i in range(max(0, int((zenith - reach) / cell_rad)), min(rows - 1, int((zenith + reach) / cell_rad)) + 1):
            # The cell of the splat nearest to the equator decides how many columns the disc covers at most.
            widest = max(math.sin((i + 0.5) * cell_rad), 0.5 * cell_rad)
            half = reach / widest
            if half > 0.5 * math.pi:
                first, last = 0, columns - 1
            else:
                first = math.floor((azimuth - half) / cell_rad)
                last = math.floor((azimuth + half) / cell_rad)
            for j in range(first, last + 1):
                m = j % columns
                nearest[i, m] = min(nearest[i, m], value)
                farthest[i, m] = max(farthest[i, m], value)


@njit(cache=True)
def erode(nearest: Array, out: Array) -> Any:  # pragma: no cover - compiled
    """Take for each cell the smallest range of its 3 x 3 neighbourhood; columns wrap around."""
    rows, columns = nearest.shape
    for i in range(rows):
        for j in range(columns):
            smallest = nearest[i, j]
            for a in range(max(0, i - 1), min(rows, i + 2)):
                for b in range(j - 1, j + 2):
                    smallest = min(smallest, nearest[a, b % columns])
            out[i, j] = smallest


@njit(cache=True)
def cell_ranges(
    points: Array, sensor: Array, cell_rad: float, nearest: Array, farthest: Array, out: Array
) -> Any:  # pragma: no cover - compiled
    """Write for each point (its range, nearest and farthest of its cell) into `out`."""
    rows, columns = nearest.shape
    for k in range(points.shape[0]):
        x = points[k, 0] - sensor[0]
        y = points[k, 1] - sensor[1]
        z = points[k, 2] - sensor[2]
        r = math.sqrt(x * x + y * y + z * z)
        zenith = 0.0 if r < 1e-9 else math.acos(min(1.0, max(-1.0, z / r)))
        row = min(rows - 1, int(zenith / cell_rad))
        column = min(columns - 1, int((math.atan2(y, x) + math.pi) / cell_rad))
        out[k, 0] = r
        out[k, 1] = nearest[row, column]
        out[k, 2] = farthest[row, column]
