"""Compiled loops of the Hough transform."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def cast_votes(
    rows: Array, columns: Array, gradients: Array, cosines: Array, sines: Array, step_px: float, least: float, bins: int
) -> Array:
    """Let every edge pixel vote for the lines through it that run along its edge, (angles, distances) int32.

    Pixel (x, y) votes in row k and column floor((x cos φ_k + y sin φ_k - least) / step + 1/2) for all φ_k within the
    tolerance that `gradients` holds: first and last angle number of each pixel, counted round modulo the angles.
    """
    votes = np.zeros((len(cosines), bins), dtype=np.int32)
    for p in range(len(rows)):
        for k in range(gradients[p, 0], gradients[p, 1] + 1):
            angle = k % len(cosines)
            r = columns[p] * cosines[angle] + rows[p] * sines[angle]
            votes[angle, math.floor((r - least) / step_px + 0.5)] += 1
    return votes


@njit(cache=True, nogil=True)
def pick_peaks(votes: Array, cells: Array, least: int, angle_reach: int, distance_reach: int, mirror: float) -> Array:
    """Take the cells in the given order (most votes first) unless a cell nearby was taken, (n, 2) angle, distance.

    `mirror` is the sum of the distance numbers of a line written with φ and with φ + 180°: beyond the last angle the
    accumulator goes on with the first one turned round.
    """
    angles, bins = votes.shape
    taken = np.zeros((angles, bins), dtype=np.bool_)
    out = np.empty((len(cells), 2), dtype=np.int64)
    found = 0
    for c in range(len(cells)):
        i, j = cells[c] // bins, cells[c] % bins
        if votes[i, j] < least or taken[i, j]:
            continue
        out[found, 0], out[found, 1] = i, j
        found += 1
        for di in range(-angle_reach, angle_reach + 1):
            a = i + di
            centre = j
            if a < 0 or a >= angles:
                a = a % angles
                centre = round(mirror - j)
            for b in range(max(0, centre - distance_reach), min(bins, centre + distance_reach + 1)):
                taken[a, b] = True
    return out[:found]
