"""Compiled sums over the pixels of patches that lie across edges."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

ARCTAN, GAUSSIAN = 0, 1
"""Shapes of the grey values across an edge."""


@njit(cache=True, nogil=True)
def _shape(kind: int, t: float, width: float) -> tuple[float, float]:
    """Give the edge function F(t / width), from -1/2 to 1/2, and its slope dF/dt."""
    z = t / width
    if kind == ARCTAN:
        return math.atan(z) / math.pi, 1.0 / (math.pi * width * (1.0 + z * z))
    return 0.5 * math.erf(z * math.sqrt(0.5)), math.exp(-0.5 * z * z) / (width * math.sqrt(2.0 * math.pi))


@njit(cache=True, nogil=True)
def patch_sums(
    grey: Array,
    centres: Array,
    normals: Array,
    half_lengths: Array,
    half_widths: Array,
    widths: Array,
    kind: int,
) -> Array:
    """Sum the normal equations of the linearised edge profile over the pixels of each patch, (n, 15).

    A patch is the rectangle around a point of the edge, `half_lengths` along it, `half_widths` across it. With
    t the pixel's distance across, the model is I = a + b F(t) + c F'(t) + e (-t / width) F'(t), where c = -b times the
    shift of the edge and e = b times the change of its width. Columns: the ten products of (1, F, F', -t F'/width) in
    the order 11 12 13 14 22 23 24 33 34 44, their four products with I, the sum of I².
    """
    height, width_px = grey.shape
    out = np.zeros((len(centres), 15))
    for k in range(len(centres)):
        x0, y0 = centres[k, 0], centres[k, 1]
        nx, ny = normals[k, 0], normals[k, 1]
        length, across, width = half_lengths[k], half_widths[k], widths[k]
        reach_x = abs(ny) * length + abs(nx) * across
        reach_y = abs(nx) * length + abs(ny) * across
        top, bottom = max(0, math.ceil(y0 - reach_y)), min(height - 1, math.floor(y0 + reach_y))
        left, right = max(0, math.ceil(x0 - reach_x)), min(width_px - 1, math.floor(x0 + reach_x))
        row = out[k]
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                dx, dy = j - x0, i - y0
                s = ny * dx - nx * dy
                t = nx * dx + ny * dy
                if s < -length or s >= length or abs(t) > across:
                    continue
                f, slope = _shape(kind, t, width)
                bend = -t / width * slope
                value = float(grey[i, j])
                row[0] += 1.0
                row[1] += f
                row[2] += slope
                row[3] += bend
                row[4] += f * f
                row[5] += f * slope
                row[6] += f * bend
                row[7] += slope * slope
                row[8] += slope * bend
                row[9] += bend * bend
                row[10] += value
                row[11] += f * value
                row[12] += slope * value
                row[13] += bend * value
                row[14] += value * value
    return out


@njit(cache=True, nogil=True)
def mean_profiles(
    grey: Array, centres: Array, normals: Array, half_lengths: Array, owners: Array, count: int, reach: int
) -> tuple[Array, Array]:
    """Average grey values by their distance across the edge in classes of half a pixel, over all patches of an edge.

    Returns
    -------
    Sums and numbers, (count, 4 reach): class k holds distances from k/2 - reach to (k + 1)/2 - reach [px].
    """
    height, width_px = grey.shape
    sums = np.zeros((count, 4 * reach))
    numbers = np.zeros((count, 4 * reach))
    for k in range(len(centres)):
        x0, y0 = centres[k, 0], centres[k, 1]
        nx, ny = normals[k, 0], normals[k, 1]
        length, owner = half_lengths[k], owners[k]
        reach_x = abs(ny) * length + abs(nx) * reach
        reach_y = abs(nx) * length + abs(ny) * reach
        top, bottom = max(0, math.ceil(y0 - reach_y)), min(height - 1, math.floor(y0 + reach_y))
        left, right = max(0, math.ceil(x0 - reach_x)), min(width_px - 1, math.floor(x0 + reach_x))
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                dx, dy = j - x0, i - y0
                s = ny * dx - nx * dy
                t = nx * dx + ny * dy
                if s < -length or s >= length or abs(t) >= reach:
                    continue
                c = int((t + reach) * 2.0)
                sums[owner, c] += grey[i, j]
                numbers[owner, c] += 1.0
    return sums, numbers


@njit(cache=True, nogil=True)
def side_sums(
    grey: Array, centres: Array, normals: Array, half_lengths: Array, half_widths: Array, widths: Array, kind: int
) -> Array:
    """Sum number, I and F of the pixels of each patch beyond half its half-width, darker side then brighter, (n, 6)."""
    height, width_px = grey.shape
    out = np.zeros((len(centres), 6))
    for k in range(len(centres)):
        x0, y0 = centres[k, 0], centres[k, 1]
        nx, ny = normals[k, 0], normals[k, 1]
        length, across, width = half_lengths[k], half_widths[k], widths[k]
        reach_x = abs(ny) * length + abs(nx) * across
        reach_y = abs(nx) * length + abs(ny) * across
        top, bottom = max(0, math.ceil(y0 - reach_y)), min(height - 1, math.floor(y0 + reach_y))
        left, right = max(0, math.ceil(x0 - reach_x)), min(width_px - 1, math.floor(x0 + reach_x))
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                dx, dy = j - x0, i - y0
                s = ny * dx - nx * dy
                t = nx * dx + ny * dy
                if s < -length or s >= length or abs(t) > across or abs(t) <= 0.5 * across:
                    continue
                side = 0 if t < 0.0 else 3
                out[k, side] += 1.0
                out[k, side + 1] += grey[i, j]
                out[k, side + 2] += _shape(kind, t, width)[0]
    return out
