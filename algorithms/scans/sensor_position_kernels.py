"""Compiled loops of the search for the instrument's position."""

import math
import sys
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

LOWER, UPPER = (0, 1) if sys.byteorder == "little" else (1, 0)
"""Where a key of 64 bits holds the number of a point, and where its range."""


@njit(cache=True, nogil=True)
def _see(coordinates: Array, eye: Array, cells: int, cell: Array, ranges: Array) -> Any:  # pragma: no cover - compiled
    """Write cell and range of every point seen from an eye.

    The cells are those of an octahedron around the eye whose lower half is folded out to a square: cheaper than angles.
    Without branches, and in single precision, the compiler does eight points at once.
    """
    one = np.float32(1.0)
    half = np.float32(0.5 * cells)
    last = np.int32(cells - 1)
    xs, ys, zs = coordinates[0], coordinates[1], coordinates[2]
    for k in range(xs.shape[0]):
        x = xs[k] - eye[0]
        y = ys[k] - eye[1]
        z = zs[k] - eye[2]
        ax, ay = abs(x), abs(y)
        per = one / max(ax + ay + abs(z), np.float32(1e-12))
        folded_u = math.copysign(one - ay * per, x)
        folded_v = math.copysign(one - ax * per, y)
        u = x * per if z >= 0 else folded_u
        v = y * per if z >= 0 else folded_v
        i = min(last, np.int32((u + one) * half))
        j = min(last, np.int32((v + one) * half))
        cell[k] = i * np.int32(cells) + j
        ranges[k] = np.sqrt(x * x + y * y + z * z)


@njit(cache=True, nogil=True)
def look_around(
    coordinates: Array,
    normals: Array,
    known: Array,
    eyes: Array,
    cells: int,
    spacing_m: float,
    start: int,
    end: int,
    found: Array,
) -> Any:  # pragma: no cover - compiled
    """Write for eyes from `start` to `end` the shares of points that are hidden and not alone in their cell, and the
    distance of the nearest point [m].

    A point is hidden when the nearest point of its cell is clearly nearer and neither lies on the other's tangent
    plane: floors and walls seen at grazing incidence spread over a range within one cell without hiding themselves.
    """
    n = coordinates.shape[1]
    nearest = np.empty(cells * cells, dtype=np.int64)
    nearest_words, nearest_ranges = nearest.view(np.int32), nearest.view(np.float32)
    cell = np.empty(n, dtype=np.int32)
    ranges = np.empty(n, dtype=np.float32)
    bits = ranges.view(np.int32)  # positive numbers are in the order of their bits
    candidates = np.empty(n + 1, dtype=np.int32)
    behind = np.float32(3.0 * spacing_m)
    nearer = np.float32(0.97)
    off = np.float32(2.0 * spacing_m)
    empty = np.iinfo(np.int64).max
    for c in range(start, end):
        _see(coordinates, eyes[c], cells, cell, ranges)
        nearest[:] = empty
        for k in range(n):
            # range and number in one key: the smallest tells both
            nearest[cell[k]] = min(nearest[cell[k]], (np.int64(bits[k]) << 32) | k)
        count = 0
        for k in range(n):  # without branches: nobody can predict them
            candidates[count] = k
            count += nearer * ranges[k] - nearest_ranges[2 * cell[k] + UPPER] >= behind
        hidden = 0
        for i in range(count):
            k = candidates[i]
            j = nearest_words[2 * cell[k] + LOWER]
            dx = coordinates[0, k] - coordinates[0, j]
            dy = coordinates[1, k] - coordinates[1, j]
            dz = coordinates[2, k] - coordinates[2, j]
            own = abs(normals[0, k] * dx + normals[1, k] * dy + normals[2, k] * dz)
            other = abs(normals[0, j] * dx + normals[1, j] * dy + normals[2, j] * dz)
            hidden += ((not known[k]) | (own >= off)) & ((not known[j]) | (other >= off))
        taken = 0
        for i in range(cells * cells):
            taken += nearest[i] != empty
        least = bits[0]
        for k in range(n):  # of bits: the compiler compares eight at once
            least = min(least, bits[k])
        found[c, 0] = hidden / n
        found[c, 1] = 1.0 - taken / n
        bits[0] = least
        found[c, 2] = ranges[0]
