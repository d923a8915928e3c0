"""Compiled loops of the adjustment of patch means: a scan has hundreds of surfaces, each adjusted a dozen times."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def adjust(jacobian: Array, misfits: Array, variances: Array) -> tuple[Array, Array]:  # noqa: C901 - one compiled loop
    """Adjust u parameters to p patch means of the given variances: corrections (u,) and covariance (u, u)."""
    p, u = jacobian.shape
    scale = np.empty(u)
    for a in range(u):
        square = 0.0
        for i in range(p):
            square += jacobian[i, a] ** 2
        scale[a] = max(math.sqrt(square / p), 1e-12)
    normal = np.zeros((u, u))
    right = np.zeros(u)
    for i in range(p):
        weight = 1.0 / variances[i]
        for a in range(u):
            right[a] += jacobian[i, a] / scale[a] * weight * misfits[i]
            for b in range(a + 1):
                normal[a, b] += jacobian[i, a] / scale[a] * weight * (jacobian[i, b] / scale[b])
    trace = 0.0
    for a in range(u):
        trace += normal[a, a]
        for b in range(a):
            normal[b, a] = normal[a, b]
    for a in range(u):
        normal[a, a] += 1e-12 * trace  # keeps points on a line solvable; such a plane gets a huge deviation
    covariance = np.linalg.inv(normal)
    corrections = covariance @ right
    for a in range(u):
        corrections[a] /= scale[a]
        for b in range(u):
            covariance[a, b] /= scale[a] * scale[b]
    return corrections, covariance


@njit(cache=True, nogil=True)
def excess(jacobian: Array, misfits: Array, variances: Array) -> float:
    """Give by how much the weighted squared residuals of patch means exceed their redundancy."""
    corrections, _ = adjust(jacobian, misfits, variances)
    total = 0.0
    for i in range(len(misfits)):
        left = misfits[i]
        for a in range(jacobian.shape[1]):
            left -= jacobian[i, a] * corrections[a]
        total += left * left / variances[i]
    return float(total - (len(misfits) - jacobian.shape[1]))


@njit(cache=True, nogil=True)
def waviness(jacobian: Array, misfits: Array, variances: Array) -> float:
    """Find what must be added to all variances for the weighted squared residuals to equal their redundancy."""
    low = 0.0
    high = np.mean(misfits**2)
    while excess(jacobian, misfits, variances + high) > 0.0:
        low, high = high, 4.0 * high
    while high - low > 0.02 * high:
        middle = 0.5 * (low + high)
        if excess(jacobian, misfits, variances + middle) > 0.0:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))
