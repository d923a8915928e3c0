"""Compiled sums over the distances between corresponding surfaces."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def scaled_design(positions: Array, normals: Array, centre: Array, radius: float) -> Array:
    """Give the derivatives (n, 6) of distances by (radius times turn about the centre, shift)."""
    out = np.empty((positions.shape[0], 6))
    for i in range(positions.shape[0]):
        x = (positions[i, 0] - centre[0]) / radius
        y = (positions[i, 1] - centre[1]) / radius
        z = (positions[i, 2] - centre[2]) / radius
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        out[i, 0] = y * nz - z * ny
        out[i, 1] = z * nx - x * nz
        out[i, 2] = x * ny - y * nx
        out[i, 3] = nx
        out[i, 4] = ny
        out[i, 5] = nz
    return out


@njit(cache=True, nogil=True)
def normal_equations(design: Array, weights: Array, gaps: Array) -> tuple[Array, Array]:
    """Sum w a aᵀ (k, k) and w a v (k,) over all rows a of the design and gaps v."""
    k = design.shape[1]
    matrix = np.zeros((k, k))
    right = np.zeros(k)
    for i in range(design.shape[0]):
        for a in range(k):
            weighted = weights[i] * design[i, a]
            right[a] += weighted * gaps[i]
            for b in range(a + 1):
                matrix[a, b] += weighted * design[i, b]
    for a in range(k):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return matrix, right


@njit(cache=True, nogil=True)
def testimonies(
    motions: Array, positions: Array, normals: Array, weights: Array, centre: Array, radius: float, facing: float
) -> Array:
    """Sum, for each motion (a column of (6, k)), weighted squares of displacement along the normals of what faces it.

    Surface faces a motion where the cosine between its normal and the displacement is above `facing`.
    """
    out = np.zeros(motions.shape[1])
    for i in range(positions.shape[0]):
        x = (positions[i, 0] - centre[0]) / radius
        y = (positions[i, 1] - centre[1]) / radius
        z = (positions[i, 2] - centre[2]) / radius
        for k in range(motions.shape[1]):
            u = motions[1, k] * z - motions[2, k] * y + motions[3, k]
            v = motions[2, k] * x - motions[0, k] * z + motions[4, k]
            w = motions[0, k] * y - motions[1, k] * x + motions[5, k]
            along = u * normals[i, 0] + v * normals[i, 1] + w * normals[i, 2]
            if along * along > facing * facing * (u * u + v * v + w * w):
                out[k] += weights[i] * along * along
    return out


@njit(cache=True, nogil=True)
def sums_of_groups(
    design: Array, weights: Array, slopes: Array, gaps: Array, normals: Array, groups: Array, count: int
) -> tuple[Array, Array, Array]:
    """Sum s a aᵀ (count, k, k), w a nᵀ (count, k, 3) and w a v (count, k) over the points of every group.

    a are the rows of the design (n, k), v the gaps and n the normals, w the weights and s the slopes.
    """
    k = design.shape[1]
    own = np.zeros((count, k, k))
    moved = np.zeros((count, k, 3))
    right = np.zeros((count, k))
    for i in range(design.shape[0]):
        g = groups[i]
        for a in range(k):
            weighted = weights[i] * design[i, a]
            right[g, a] += weighted * gaps[i]
            for b in range(3):
                moved[g, a, b] += weighted * normals[i, b]
            for b in range(a + 1):
                own[g, a, b] += slopes[i] * design[i, a] * design[i, b]
    for g in range(count):
        for a in range(k):
            for b in range(a):
                own[g, b, a] = own[g, a, b]
    return own, moved, right


@njit(cache=True, nogil=True)
def changes_without(  # noqa: C901, PLR0912 - one compiled loop
    matrix: Array, own: Array, right: Array, least: float
) -> tuple[Array, Array]:
    """Solve (N - N_c) x = u_c for every group c by factorisations of Cholesky: x (g, k), and which were solved (g,).

    Left alone is what has a pivot below `least` times the largest element of its diagonal.
    """
    count, k = right.shape
    out = np.zeros((count, k))
    solved = np.ones(count, dtype=np.bool_)
    lower = np.empty((k, k))
    for g in range(count):
        largest = 0.0
        for a in range(k):
            largest = max(largest, matrix[a, a] - own[g, a, a])
        for a in range(k):
            for b in range(a + 1):
                rest = matrix[a, b] - own[g, a, b]
                for i in range(b):
                    rest -= lower[a, i] * lower[b, i]
                if b < a:
                    lower[a, b] = rest / lower[b, b]
                elif rest > least * largest:
                    lower[a, a] = np.sqrt(rest)
                else:
                    solved[g] = False
                    break
            if not solved[g]:
                break
        if not solved[g]:
            continue
        for a in range(k):
            value = right[g, a]
            for i in range(a):
                value -= lower[a, i] * out[g, i]
            out[g, a] = value / lower[a, a]
        for a in range(k - 1, -1, -1):
            value = out[g, a]
            for i in range(a + 1, k):
                value -= lower[i, a] * out[g, i]
            out[g, a] = value / lower[a, a]
    return out, solved
