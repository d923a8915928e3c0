"""Compiled sums for telling bent regions from flat ones."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def sums_of_pieces(labels: Array, positions: Array, heights: Array, weights: Array, half_widths: Array) -> Array:
    """Add what parabolas along both axes of every region need, from its pieces.

    Returns (k, 2, 10): with u the position in half widths and h the height, the weighted sums of 1, u, u², u³, u⁴, of
    h, h u, h u², of h², and the number of pieces.
    """
    out = np.zeros((half_widths.shape[0], 2, 10))
    for i in range(labels.shape[0]):
        p = labels[i]
        _add(out, p, 0, positions[i, 0] / half_widths[p, 0], heights[i], weights[i])
        _add(out, p, 1, positions[i, 1] / half_widths[p, 1], heights[i], weights[i])
    return out


@njit(cache=True, nogil=True)
def sums_of_cells(
    labels: Array, moments: Array, regions: Array, normals: Array, bases: Array, half: Array, start: int, end: int
) -> Array:
    """Add the same from the means of the cells from `start` to `end`, each counting once.

    `labels` is the region of every cell, -1 for none; `moments` and `regions` hold count and mean of cells and regions.
    """
    out = np.zeros((half.shape[0], 2, 10))
    for cell in range(start, end):
        p = labels[cell]
        if p < 0:
            continue
        u = v = h = 0.0
        for a in range(3):
            x = moments[cell, 1 + a] - regions[p, 1 + a]
            u += x * bases[p, a, 0]
            v += x * bases[p, a, 1]
            h += x * normals[p, a]
        _add(out, p, 0, u / half[p, 0], h, 1.0)
        _add(out, p, 1, v / half[p, 1], h, 1.0)
    return out


@njit(cache=True, nogil=True, inline="always")
def _add(out: Array, p: int, axis: int, u: float, h: float, w: float) -> None:
    """Add one piece to the sums of region p along an axis."""
    out[p, axis, 0] += w
    out[p, axis, 1] += w * u
    out[p, axis, 2] += w * u * u
    out[p, axis, 3] += w * u * u * u
    out[p, axis, 4] += w * u * u * u * u
    out[p, axis, 5] += w * h
    out[p, axis, 6] += w * h * u
    out[p, axis, 7] += w * h * u * u
    out[p, axis, 8] += w * h * h
    out[p, axis, 9] += 1.0
