"""Compiled sums over the pixels of patches that lie across edges."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

ARCTAN, GAUSSIAN = 0, 1
"""Shapes of the grey values across an edge."""

TABLE_END, TABLE_STEPS = 6.0, 64
"""The Gaussian edge function is read from a table, linear between its entries: right to 1e-5, three times as fast."""
_Z = np.linspace(-TABLE_END, TABLE_END, int(2 * TABLE_END * TABLE_STEPS) + 1)
GAUSSIAN_EDGE = np.array([0.5 * math.erf(z * math.sqrt(0.5)) for z in _Z])
GAUSSIAN_SLOPE = np.exp(-0.5 * _Z**2) / math.sqrt(2.0 * math.pi)


@njit(cache=True, nogil=True)
def _shape(kind: int, t: float, width: float) -> tuple[float, float]:
    """Give the edge function F(t / width), from -1/2 to 1/2, and its slope dF/dt."""
    z = t / width
    if kind == ARCTAN:
        return math.atan(z) / math.pi, 1.0 / (math.pi * width * (1.0 + z * z))
    place = (min(max(z, -TABLE_END), TABLE_END) + TABLE_END) * TABLE_STEPS
    k = min(int(place), len(GAUSSIAN_EDGE) - 2)
    part = place - k
    f = GAUSSIAN_EDGE[k] + part * (GAUSSIAN_EDGE[k + 1] - GAUSSIAN_EDGE[k])
    return f, (GAUSSIAN_SLOPE[k] + part * (GAUSSIAN_SLOPE[k + 1] - GAUSSIAN_SLOPE[k])) / width


@njit(cache=True, nogil=True)
def _row_part(
    dy: float, x0: float, nx: float, ny: float, length: float, across: float, left: int, right: int
) -> tuple[int, int]:
    """Give first and last column, a little generous, of the pixels of a patch in the row at distance `dy`."""
    low, high = float(left), float(right)
    if abs(ny) > 1e-6:
        a, b = x0 + (nx * dy - length) / ny, x0 + (nx * dy + length) / ny
        low, high = max(low, min(a, b) - 1e-6), min(high, max(a, b) + 1e-6)
    if abs(nx) > 1e-6:
        a, b = x0 + (-ny * dy - across) / nx, x0 + (-ny * dy + across) / nx
        low, high = max(low, min(a, b) - 1e-6), min(high, max(a, b) + 1e-6)
    return math.ceil(low), math.floor(high)


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
            first, last = _row_part(i - y0, x0, nx, ny, length, across, left, right)
            for j in range(first, last + 1):
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


@njit(cache=True, nogil=True)
def _levels(sums: Array) -> tuple[float, float]:
    """Give the contrast b of I = a + b F from sums, and its variance for unit noise; 0, 0 if not determined."""
    determinant = sums[0] * sums[4] - sums[1] * sums[1]
    if determinant <= 1e-6 * sums[0] * sums[4]:
        return 0.0, 0.0
    return (sums[0] * sums[11] - sums[1] * sums[10]) / determinant, sums[0] / determinant


@njit(cache=True, nogil=True)
def solve_patches(sums: Array, owners: Array, neighbours: int) -> Array:
    """Solve the normal equations of every patch, (n, 6).

    Columns: c of I = a + b F + c F', its variance for unit noise (0 where it is not determined), the sum of squared
    residuals, contrast b of I = a + b F, its variance, and b from the patch with its `neighbours` to both sides.
    """
    count = len(sums)
    out = np.zeros((count, 6))
    nearby = np.empty(sums.shape[1])
    for k in range(count):
        row = sums[k]
        out[k, 3], out[k, 4] = _levels(row)
        nearby[:] = 0.0
        for m in range(max(0, k - neighbours), min(count, k + neighbours + 1)):
            if owners[m] == owners[k]:
                nearby += sums[m]
        out[k, 5] = _levels(nearby)[0]
        n = row[0]
        if n < 4.0:
            continue
        # the constant is eliminated: what remains are products of deviations from the means
        ff, fs, ss = row[4] - row[1] * row[1] / n, row[5] - row[1] * row[2] / n, row[7] - row[2] * row[2] / n
        fi, si = row[11] - row[1] * row[10] / n, row[12] - row[2] * row[10] / n
        determinant = ff * ss - fs * fs
        if determinant <= 1e-5 * row[4] * row[7]:
            continue
        b, c = (ss * fi - fs * si) / determinant, (ff * si - fs * fi) / determinant
        out[k, 0], out[k, 1] = c, ff / determinant
        out[k, 2] = max(0.0, row[14] - row[10] * row[10] / n - b * fi - c * si)
    return out


@njit(cache=True, nogil=True)
def sums_by_owner(sums: Array, owners: Array, count: int) -> Array:
    """Add the rows of each owner, (count, columns)."""
    out = np.zeros((count, sums.shape[1]))
    for k in range(len(sums)):
        out[owners[k]] += sums[k]
    return out
