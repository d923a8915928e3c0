"""Compiled loops of the spherical range image."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

ATAN = (
    0.999999999614526,
    -0.333333236656277,
    0.199995958541901,
    -0.142790484170748,
    0.110537847542098,
    -0.0879611756048448,
    0.0671011399484662,
    -0.0442736683407883,
    0.022203454966291,
    -0.0071661649176158,
    0.00108449275467796,
)
"""Coefficients of atan(t) / t by powers of t squared, for t from 0 to 1: least squares, to within 3e-10 rad."""


BATCH = 128
"""Directions are computed for so many points at once: the loop over them is compiled into vector instructions."""


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _angle(y: float, x: float) -> float:
    """Give atan2(y, x) to within 3e-10 rad, in a fraction of the time."""
    wide = abs(x)
    high = abs(y)
    steep = high > wide
    t = (wide if steep else high) / ((high if steep else wide) + 1e-300)
    s = t * t
    low = ATAN[0] + s * (ATAN[1] + s * (ATAN[2] + s * ATAN[3]))
    middle = ATAN[4] + s * (ATAN[5] + s * (ATAN[6] + s * ATAN[7]))
    value = t * (low + s * s * s * s * (middle + s * s * s * s * (ATAN[8] + s * (ATAN[9] + s * ATAN[10]))))
    value = 0.5 * math.pi - value if steep else value
    value = math.pi - value if x < 0.0 else value
    return -value if y < 0.0 else value


@njit(cache=True, nogil=True)
def _rays(points: Array, sensor: Array, x: Array, y: Array, z: Array) -> None:
    """Write the rays to the points, each axis for itself: vectors are loaded from places that follow each other."""
    for k in range(points.shape[0]):
        x[k] = points[k, 0] - sensor[0]
        y[k] = points[k, 1] - sensor[1]
        z[k] = points[k, 2] - sensor[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _directions(x: Array, y: Array, z: Array, ranges: Array, zeniths: Array, azimuths: Array) -> None:
    """Write the lengths of rays, their zenith angles and azimuths (from 0)."""
    for k in range(x.shape[0]):
        square = x[k] * x[k] + y[k] * y[k]
        ranges[k] = math.sqrt(square + z[k] * z[k])
        zeniths[k] = _angle(math.sqrt(square), z[k])
        azimuths[k] = _angle(y[k], x[k]) + math.pi


@njit(cache=True, nogil=True)
def fill(
    points: Array,
    sensor: Array,
    cell_rad: float,
    splat_m: float,
    start: int,
    end: int,
    nearest: Array,
    farthest: Array,
) -> Any:  # pragma: no cover - compiled
    """Enter the points from `start` to `end` with their ranges; each covers the cells within `splat_m` of it."""
    rows = nearest.shape[0]
    # The cell of the splat nearest to the equator decides how many columns the disc covers at most.
    widest = np.empty(rows)
    for i in range(rows):
        widest[i] = 1.0 / max(math.sin((i + 0.5) * cell_rad), 0.5 * cell_rad)
    x, y, z = np.empty(BATCH), np.empty(BATCH), np.empty(BATCH)
    ranges, zeniths, azimuths = np.empty(BATCH), np.empty(BATCH), np.empty(BATCH)
    for first in range(start, end, BATCH):
        some = points[first : min(first + BATCH, end)]
        count = len(some)
        _rays(some, sensor, x, y, z)
        _directions(x[:count], y, z, ranges, zeniths, azimuths)
        _enter(ranges[:count], zeniths, azimuths, cell_rad, splat_m, widest, nearest, farthest)


@njit(cache=True, nogil=True)
def _enter(
    ranges: Array,
    zeniths: Array,
    azimuths: Array,
    cell_rad: float,
    splat_m: float,
    widest: Array,
    nearest: Array,
    farthest: Array,
) -> None:
    """Enter points by range, zenith angle and azimuth."""
    rows, columns = nearest.shape
    per_cell = 1.0 / cell_rad
    for k in range(len(ranges)):
        r, zenith, azimuth = ranges[k], zeniths[k], azimuths[k]
        if r < 1e-6:
            continue
        value = np.float32(r)
        if splat_m <= 0.0:
            row = min(rows - 1, int(zenith * per_cell))
            column = min(columns - 1, int(azimuth * per_cell))
            nearest[row, column] = min(nearest[row, column], value)
            farthest[row, column] = max(farthest[row, column], value)
            continue
        reach = min(splat_m / r, 0.2)
        for i in range(max(0, int((zenith - reach) * per_cell)), min(rows - 1, int((zenith + reach) * per_cell)) + 1):
            half = reach * widest[i]
            if half > 0.5 * math.pi:
                first, last = 0, columns - 1
            else:
                first = math.floor((azimuth - half) * per_cell)
                last = math.floor((azimuth + half) * per_cell)
            for j in range(first, last + 1):
                m = j
                if m < 0:
                    m += columns
                elif m >= columns:
                    m -= columns
                nearest[i, m] = min(nearest[i, m], value)
                farthest[i, m] = max(farthest[i, m], value)


@njit(cache=True)
def smallest_around(nearest: Array, empty_only: bool, out: Array) -> Any:  # pragma: no cover - compiled
    """Take for each cell, or for those in which nothing was seen, the smallest range of its 3 x 3 neighbourhood.

    Columns wrap around.
    """
    rows, columns = nearest.shape
    for i in range(rows):
        for j in range(columns):
            smallest = nearest[i, j]
            if not empty_only or smallest == np.inf:
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
