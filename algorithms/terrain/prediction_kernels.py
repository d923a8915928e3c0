"""Compiled linear prediction, unit after unit."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _plane(points: Array, weights: Array, numbers: Array, cx: float, cy: float) -> Array:
    """Fit a weighted plane about a place; level where points do not determine one."""
    normal = np.zeros((3, 3))
    right = np.zeros(3)
    for i in numbers:
        w = weights[i]
        x = points[i, 0] - cx
        y = points[i, 1] - cy
        row = (1.0, x, y)
        for a in range(3):
            right[a] += w * row[a] * points[i, 2]
            for b in range(3):
                normal[a, b] += w * row[a] * row[b]
    plane = np.zeros(3)
    if normal[0, 0] <= 0.0:
        for i in numbers:
            plane[0] += points[i, 2] / len(numbers)
        return plane
    mx = normal[0, 1] / normal[0, 0]
    my = normal[0, 2] / normal[0, 0]
    mz = right[0] / normal[0, 0]
    cxx = normal[1, 1] - normal[0, 0] * mx * mx
    cxy = normal[1, 2] - normal[0, 0] * mx * my
    cyy = normal[2, 2] - normal[0, 0] * my * my
    cxz = right[1] - normal[0, 0] * mx * mz
    cyz = right[2] - normal[0, 0] * my * mz
    det = cxx * cyy - cxy * cxy
    if det > 1e-3 * (0.5 * (cxx + cyy)) ** 2 and normal[0, 0] > 3.0:
        plane[1] = (cyy * cxz - cxy * cyz) / det
        plane[2] = (cxx * cyz - cxy * cxz) / det
    plane[0] = mz - plane[1] * mx - plane[2] * my
    return plane


@njit(cache=True, nogil=True)
def _factorised(points: Array, weights: Array, used: Array, scale: float, variance: float, noise: float) -> Array:
    """Give the lower Cholesky factor of the covariance of points, written here: threads of a library would collide."""
    m = len(used)
    lower = np.zeros((m, m))
    for a in range(m):
        for b in range(a + 1):
            i, j = used[a], used[b]
            d2 = (points[i, 0] - points[j, 0]) ** 2 + (points[i, 1] - points[j, 1]) ** 2
            total = variance * math.exp(scale * d2)
            if a == b:
                total += noise * noise / weights[i]
            for k in range(b):
                total -= lower[a, k] * lower[b, k]
            lower[a, b] = math.sqrt(total) if a == b else total / lower[b, b]
    return lower


@njit(cache=True, nogil=True)
def _forward(lower: Array, right: Array) -> None:
    """Solve lower · x = right in place."""
    for a in range(len(right)):
        total = right[a]
        for k in range(a):
            total -= lower[a, k] * right[k]
        right[a] = total / lower[a, a]


@njit(cache=True, nogil=True)
def _backward(lower: Array, right: Array) -> None:
    """Solve lowerᵀ · x = right in place."""
    for a in range(len(right) - 1, -1, -1):
        right[a] /= lower[a, a]
        for k in range(a):
            right[k] -= lower[a, k] * right[a]


@njit(cache=True, nogil=True)
def predict_unit(
    points: Array,
    weights: Array,
    numbers: Array,
    places: Array,
    cx: float,
    cy: float,
    correlation: float,
    relief: float,
    noise: float,
    least: float,
    with_variances: bool,
) -> tuple[Array, Array]:
    """Predict heights at places from the numbered points, and their variances if wanted (else NaN).

    z = trend + s + n with cov(s_i, s_j) = relief² exp(-d² / 2 correlation²) and var n_i = noise² / w_i; points whose
    weight is below `least` do not take part. The trend is a plane through the points about (cx, cy).
    """
    used = numbers[weights[numbers] >= least]
    plane = _plane(points, weights, used if len(used) else numbers, cx, cy)
    variance = relief * relief
    scale = -0.5 / (correlation * correlation)
    heights = plane[0] + plane[1] * (places[:, 0] - cx) + plane[2] * (places[:, 1] - cy)
    variances = np.full(len(places), variance if with_variances else np.nan)
    if len(used) == 0:
        return heights, variances
    lower = _factorised(points, weights, used, scale, variance, noise)
    x, y = points[used, 0], points[used, 1]
    factors = points[used, 2] - (plane[0] + plane[1] * (x - cx) + plane[2] * (y - cy))
    _forward(lower, factors)
    _backward(lower, factors)
    for k in range(len(places)):
        across = variance * np.exp(scale * ((x - places[k, 0]) ** 2 + (y - places[k, 1]) ** 2))
        heights[k] += (across * factors).sum()
        if with_variances:
            _forward(lower, across)
            variances[k] = max(variance - (across * across).sum(), 0.0)
    return heights, variances
