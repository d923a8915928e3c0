"""Compiled loops for normals: pooling of moments and the closed-form eigenvectors of 3x3 matrices."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def smallest_axis(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> tuple[float, ...]:
    """Give the three eigenvalues (ascending) of a symmetric 3x3 matrix and the eigenvector of the smallest.

    Trigonometric solution of the characteristic cubic; the vector is the longest cross product of two rows of A - l I.
    The vector is zero when it is not determined (smallest eigenvalue double).
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
    phi = math.acos(min(1.0, max(-1.0, half))) / 3.0
    l3 = q + 2.0 * p * math.cos(phi)
    l1 = q + 2.0 * p * math.cos(phi + 2.0943951023931953)
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
def pool_moments(moments: Array, neighbours: Array, cap: float, wanted: Array) -> Array:
    """Add the moments of every wanted cell and its neighbours, each with a weight of at most `cap` points.

    Moments are count, mean, central sums of products; so are the pooled ones. Sums are formed about the cell's own
    mean.
    """
    m = moments.shape[0]
    pooled = np.zeros((m, 10))
    for cell in range(m):
        if not wanted[cell]:
            continue
        own = moments[cell]
        n = 0.0
        sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        for k in range(-1, neighbours.shape[1]):
            other = cell if k < 0 else neighbours[cell, k]
            if other < 0:
                continue
            part = moments[other]
            if part[0] <= 0.0:
                continue
            w = min(part[0], cap)
            f = w / part[0]
            x = part[1] - own[1]
            y = part[2] - own[2]
            z = part[3] - own[3]
            n += w
            sx += w * x
            sy += w * y
            sz += w * z
            xx += f * part[4] + w * x * x
            xy += f * part[5] + w * x * y
            xz += f * part[6] + w * x * z
            yy += f * part[7] + w * y * y
            yz += f * part[8] + w * y * z
            zz += f * part[9] + w * z * z
        if n <= 0.0:
            continue
        sx /= n
        sy /= n
        sz /= n
        out = pooled[cell]
        out[0] = n
        out[1] = own[1] + sx
        out[2] = own[2] + sy
        out[3] = own[3] + sz
        out[4] = xx - n * sx * sx
        out[5] = xy - n * sx * sy
        out[6] = xz - n * sx * sz
        out[7] = yy - n * sy * sy
        out[8] = yz - n * sy * sz
        out[9] = zz - n * sz * sz
    return pooled


@njit(cache=True, nogil=True)
def surface_of_moments(moments: Array, min_count: float) -> tuple[Array, Array, Array]:
    """Give normal, standard deviation across it, and the middle standard deviation, for every row of moments."""
    m = moments.shape[0]
    normals = np.zeros((m, 3))
    residual = np.full(m, np.inf)
    width = np.zeros(m)
    for cell in range(m):
        row = moments[cell]
        n = row[0]
        if n < min_count:
            continue
        l1, l2, l3, x, y, z = smallest_axis(row[4] / n, row[5] / n, row[6] / n, row[7] / n, row[8] / n, row[9] / n)
        if x * x + y * y + z * z < 0.5 or l2 <= 1e-6 * l3:
            continue  # points on a line or in a spot span no surface
        normals[cell, 0] = x
        normals[cell, 1] = y
        normals[cell, 2] = z
        residual[cell] = math.sqrt(max(l1, 0.0))
        width[cell] = math.sqrt(max(l2, 0.0))
    return normals, residual, width
