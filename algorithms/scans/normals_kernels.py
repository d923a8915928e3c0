"""Compiled loops for normals: pooling of moments and the closed-form eigenvectors of 3x3 matrices."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array

THIRD = (
    0.8660254053677893,
    0.1666663996237125,
    -0.04810502173025254,
    0.0246088319497565,
    -0.01512476317273772,
    0.009420074576995407,
    -0.004972568158473238,
    0.001790960549849526,
    -0.000309320186334182,
)
"""Coefficients of cos(acos(h) / 3) by powers of h, for h from 0 to 1: least squares, to within 2e-9."""


@njit(cache=True, nogil=True)
def smallest_axis(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> tuple[float, ...]:
    """Give the three eigenvalues (ascending) of a symmetric 3x3 matrix and the eigenvector of the smallest.

    Trigonometric solution of the characteristic cubic, with the cosine of a third of an angle from the cosine of the
    angle: a polynomial and one step of Newton take a third of the time of acos and cos. The vector is the longest cross
    product of two rows of A - l I; it is zero when it is not determined (smallest eigenvalue double).
    """
    q = (xx + yy + zz) / 3.0
    p2 = (xx - q) ** 2 + (yy - q) ** 2 + (zz - q) ** 2 + 2.0 * (xy * xy + xz * xz + yz * yz)
    p = math.sqrt(p2 / 6.0)
    if p <= 1e-300:
        return q, q, q, 0.0, 0.0, 0.0
    a = (xx - q) / p
    b = (yy - q) / p
    c = (zz - q) / p
    d = xy / p
    e = xz / p
    f = yz / p
    half = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    h = min(1.0, abs(half))
    root = THIRD[8]
    for k in range(7, -1, -1):
        root = root * h + THIRD[k]
    root -= (root * (4.0 * root * root - 3.0) - h) / (12.0 * root * root - 3.0)  # 4 cos^3 - 3 cos = cos of thrice it
    rest = root + math.sqrt(max(3.0 - 3.0 * root * root, 0.0))
    l1 = q - p * (rest if half >= 0.0 else 2.0 * root)
    l3 = q + p * (2.0 * root if half >= 0.0 else rest)
    l2 = 3.0 * q - l1 - l3
    a = xx - l1
    b = yy - l1
    c = zz - l1
    x1 = xy * yz - xz * b
    y1 = xz * xy - a * yz
    z1 = a * b - xy * xy
    x2 = xy * c - xz * yz
    y2 = xz * xz - a * c
    z2 = a * yz - xy * xz
    x3 = b * c - yz * yz
    y3 = yz * xz - xy * c
    z3 = xy * yz - b * xz
    n1 = x1 * x1 + y1 * y1 + z1 * z1
    n2 = x2 * x2 + y2 * y2 + z2 * z2
    n3 = x3 * x3 + y3 * y3 + z3 * z3
    if n2 > n1:
        x1, y1, z1, n1 = x2, y2, z2, n2
    if n3 > n1:
        x1, y1, z1, n1 = x3, y3, z3, n3
    if n1 <= 1e-300:
        return l1, l2, l3, 0.0, 0.0, 0.0
    s = 1.0 / math.sqrt(n1)
    return l1, l2, l3, x1 * s, y1 * s, z1 * s


@njit(cache=True, nogil=True)
def _pool(moments: Array, neighbours: Array, cap: float, cell: int, out: Array) -> None:
    """Add the moments of a cell and its neighbours, each with a weight of at most `cap` points.

    Moments are count, mean, central sums of products; so are the pooled ones. Sums are formed about the cell's own
    mean.
    """
    ox, oy, oz = moments[cell, 1], moments[cell, 2], moments[cell, 3]
    n = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for k in range(-1, neighbours.shape[1]):
        other = cell if k < 0 else neighbours[cell, k]
        if other < 0:
            continue
        count = moments[other, 0]
        if count <= 0.0:
            continue
        w = count
        f = 1.0
        if count > cap:
            w = cap
            f = cap / count
        x = moments[other, 1] - ox
        y = moments[other, 2] - oy
        z = moments[other, 3] - oz
        n += w
        sx += w * x
        sy += w * y
        sz += w * z
        xx += f * moments[other, 4] + w * x * x
        xy += f * moments[other, 5] + w * x * y
        xz += f * moments[other, 6] + w * x * z
        yy += f * moments[other, 7] + w * y * y
        yz += f * moments[other, 8] + w * y * z
        zz += f * moments[other, 9] + w * z * z
    out[0] = n
    if n <= 0.0:
        out[1:] = 0.0
        return
    sx /= n
    sy /= n
    sz /= n
    out[1] = ox + sx
    out[2] = oy + sy
    out[3] = oz + sz
    out[4] = xx - n * sx * sx
    out[5] = xy - n * sx * sy
    out[6] = xz - n * sx * sz
    out[7] = yy - n * sy * sy
    out[8] = yz - n * sy * sz
    out[9] = zz - n * sz * sz


@njit(cache=True, nogil=True)
def _fit(row: Array, min_count: float, cell: int, normals: Array, residual: Array, width: Array) -> None:
    """Write normal, standard deviation across it, and the middle standard deviation of a row of moments."""
    n = row[0]
    per = 1.0 / max(n, 1.0)
    l1, l2, l3, x, y, z = smallest_axis(
        per * row[4], per * row[5], per * row[6], per * row[7], per * row[8], per * row[9]
    )
    if n < min_count or x * x + y * y + z * z < 0.5 or l2 <= 1e-6 * l3:
        # points on a line or in a spot span no surface
        x = y = z = l2 = 0.0
        l1 = np.inf
    normals[cell, 0] = x
    normals[cell, 1] = y
    normals[cell, 2] = z
    residual[cell] = math.sqrt(max(l1, 0.0))
    width[cell] = math.sqrt(max(l2, 0.0))


@njit(cache=True, nogil=True)
def pooled_surfaces(
    moments: Array,
    neighbours: Array,
    cap: float,
    min_count: float,
    start: int,
    end: int,
    pooled: Array,
    normals: Array,
    residual: Array,
    width: Array,
) -> None:
    """Pool the moments around the cells from `start` to `end`, and fit a tangent plane to each."""
    for cell in range(start, end):
        _pool(moments, neighbours, cap, cell, pooled[cell])
        _fit(pooled[cell], min_count, cell, normals, residual, width)


@njit(cache=True, nogil=True)
def wider_surfaces(
    pooled: Array,
    neighbours: Array,
    narrow: Array,
    min_count: float,
    start: int,
    end: int,
    normals: Array,
    residual: Array,
    width: Array,
) -> None:
    """Pool the pooled moments of the narrow cells from `start` to `end` once more, and fit their tangent planes."""
    row = np.empty(10)
    for cell in range(start, end):
        if narrow[cell]:
            _pool(pooled, neighbours, np.inf, cell, row)
            _fit(row, min_count, cell, normals, residual, width)


@njit(cache=True, nogil=True)
def turn_normals(normals: Array, moments: Array, sensor: Array, start: int, end: int, out: Array) -> None:
    """Write the normals of the cells from `start` to `end`, turned towards the sensor."""
    for cell in range(start, end):
        away = 0.0
        for a in range(3):
            away += normals[cell, a] * (moments[cell, 1 + a] - sensor[a])
        for a in range(3):
            out[cell, a] = -normals[cell, a] if away > 0.0 else normals[cell, a]
