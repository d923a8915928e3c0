"""Compiled loops of the fit of one cylinder: its points in its own coordinates, and sums over blocks."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def unrolled(points: Array, c: Array, d: Array, basis: Array, r: float) -> tuple[Array, Array, Array]:
    """Give every point's place along the axis, its angle around it, and its distance from the surface, (n,) each."""
    n = points.shape[0]
    along = np.empty(n)
    angle = np.empty(n)
    misfit = np.empty(n)
    for i in range(n):
        s = u = v = 0.0
        for a in range(3):
            x = points[i, a] - c[a]
            s += x * d[a]
            u += x * basis[a, 0]
            v += x * basis[a, 1]
        along[i] = s
        angle[i] = math.atan2(v, u)
        misfit[i] = math.sqrt(u * u + v * v) - r
    return along, angle, misfit


@njit(cache=True, nogil=True)
def sum_blocks(along: Array, angle: Array, misfit: Array, length: float, rows: int, columns: int) -> Array:
    """Sum points per block of the surface, row by row along the axis.

    Returns (rows * columns, 6): count, place along the axis, cosine and sine of the angle, misfit, squared misfit.
    """
    out = np.zeros((rows * columns, 6))
    low = np.min(along)
    for i in range(len(along)):
        row = min(int((along[i] - low) / length * rows), rows - 1)
        column = int((angle[i] + math.pi) / (2.0 * math.pi) * columns) % columns
        block = row * columns + column
        out[block, 0] += 1.0
        out[block, 1] += along[i]
        out[block, 2] += math.cos(angle[i])
        out[block, 3] += math.sin(angle[i])
        out[block, 4] += misfit[i]
        out[block, 5] += misfit[i] ** 2
    return out
