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


BATCH = 64
"""Tangent planes are fitted to so many sums at once: the loop over them is compiled into vector instructions."""


@njit(cache=True, nogil=True, error_model="numpy", inline="always")  # only inlined, loops become vectors
def smallest_axis(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> tuple[float, ...]:
    """Give the three eigenvalues (ascending) of a symmetric 3x3 matrix and the eigenvector of the smallest.

    Trigonometric solution of the characteristic cubic, with the cosine of a third of an angle from the cosine of the
    angle: a polynomial and one step of Newton take a third of the time of acos and cos. The vector is the longest cross
    product of two rows of A - l I; it is zero when it is not determined (smallest eigenvalue double). There is no jump
    in it, so a loop over many matrices becomes vector instructions.
    """
    q = (xx + yy + zz) / 3.0
    p2 = (xx - q) ** 2 + (yy - q) ** 2 + (zz - q) ** 2 + 2.0 * (xy * xy + xz * xz + yz * yz)
    p = math.sqrt(p2 / 6.0)
    per = 1.0 / (p if p > 1e-300 else 1.0)
    a = (xx - q) * per
    b = (yy - q) * per
    c = (zz - q) * per
    d = xy * per
    e = xz * per
    f = yz * per
    half = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    h = min(1.0, abs(half))
    low = THIRD[0] + h * (THIRD[1] + h * (THIRD[2] + h * THIRD[3]))
    high = THIRD[4] + h * (THIRD[5] + h * (THIRD[6] + h * (THIRD[7] + h * THIRD[8])))
    root = low + h * h * h * h * high
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
    s = 1.0 / math.sqrt(n1) if n1 > 1e-300 else 0.0
    return l1, l2, l3, x1 * s, y1 * s, z1 * s


@njit(cache=True, nogil=True)
def _pool(moments: Array, neighbours: Array, cap: float, cell: int, out: Array) -> None:
    """Add the moments of a cell and its neighbours, each with a weight of at most `cap` points.

    Moments are count, mean, central sums of products; so are the pooled ones. Sums are formed about the cell's own
    mean.
    """
    own = moments[cell]
    ox, oy, oz = own[1], own[2], own[3]
    n = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for k in range(-1, neighbours.shape[1]):
        other = cell if k < 0 else neighbours[cell, k]
        if other < 0:
            continue
        row = moments[other]
        count = row[0]
        if count <= 0.0:
            continue
        w = count
        f = 1.0
        if count > cap:
            w = cap
            f = cap / count
        x = row[1] - ox
        y = row[2] - oy
        z = row[3] - oz
        wx = w * x
        wy = w * y
        wz = w * z
        n += w
        sx += wx
        sy += wy
        sz += wz
        xx += f * row[4] + wx * x
        xy += f * row[5] + wx * y
        xz += f * row[6] + wx * z
        yy += f * row[7] + wy * y
        yz += f * row[8] + wy * z
        zz += f * row[9] + wz * z
    out[0] = n
    if n <= 0.0:
        out[1:] = 0.0
        return
    ax = sx / n
    ay = sy / n
    az = sz / n
    out[1] = ox + ax
    out[2] = oy + ay
    out[3] = oz + az
    out[4] = xx - sx * ax
    out[5] = xy - sx * ay
    out[6] = xz - sx * az
    out[7] = yy - sy * ay
    out[8] = yz - sy * az
    out[9] = zz - sz * az


@njit(cache=True, nogil=True, error_model="numpy")
def _smallest_axes(covariances: Array, out: Array) -> None:
    """Write what `smallest_axis` gives of each column of (6, n) into the columns of (6, n)."""
    for i in range(covariances.shape[1]):
        out[0, i], out[1, i], out[2, i], out[3, i], out[4, i], out[5, i] = smallest_axis(
            covariances[0, i],
            covariances[1, i],
            covariances[2, i],
            covariances[3, i],
            covariances[4, i],
            covariances[5, i],
        )


@njit(cache=True, nogil=True)
def _fit(
    rows: Array, cells: Array, count: int, min_count: float, normals: Array, residual: Array, width: Array
) -> None:
    """Write normal, standard deviation across it, and the middle standard deviation of the first rows of moments.

    `cells` tells to which cell each row belongs; there are at most `BATCH`.
    """
    covariances = np.empty((6, BATCH))
    axes = np.empty((6, BATCH))
    for i in range(count):
        per = 1.0 / max(rows[i, 0], 1.0)
        for a in range(6):
            covariances[a, i] = per * rows[i, 4 + a]
    covariances[:, count:] = 0.0
    _smallest_axes(covariances, axes)
    for i in range(count):
        l1, l2, l3, x, y, z = axes[0, i], axes[1, i], axes[2, i], axes[3, i], axes[4, i], axes[5, i]
        if rows[i, 0] < min_count or x * x + y * y + z * z < 0.5 or l2 <= 1e-6 * l3:
            # points on a line or in a spot span no surface
            x = y = z = l2 = 0.0
            l1 = np.inf
        cell = cells[i]
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
    cells = np.empty(BATCH, dtype=np.int64)
    for first in range(start, end, BATCH):
        count = min(BATCH, end - first)
        for i in range(count):
            cells[i] = first + i
            _pool(moments, neighbours, cap, first + i, pooled[first + i])
        _fit(pooled[first : first + count], cells, count, min_count, normals, residual, width)


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
    rows = np.empty((BATCH, 10))
    cells = np.empty(BATCH, dtype=np.int64)
    count = 0
    for cell in range(start, end):
        if not narrow[cell]:
            continue
        _pool(pooled, neighbours, np.inf, cell, rows[count])
        cells[count] = cell
        count += 1
        if count == BATCH:
            _fit(rows, cells, count, min_count, normals, residual, width)
            count = 0
    _fit(rows, cells, count, min_count, normals, residual, width)


@njit(cache=True, nogil=True)
def turn_normals(normals: Array, moments: Array, sensor: Array, start: int, end: int, out: Array) -> None:
    """Write the normals of the cells from `start` to `end`, turned towards the sensor."""
    for cell in range(start, end):
        away = 0.0
        for a in range(3):
            away += normals[cell, a] * (moments[cell, 1 + a] - sensor[a])
        for a in range(3):
            out[cell, a] = -normals[cell, a] if away > 0.0 else normals[cell, a]
