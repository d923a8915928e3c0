"""Loops over cells of the normal distributions transform in space, compiled."""

import math

import numba as nb
import numpy as np

from algorithms.arrays import Array

FARTHEST_EXPONENT = 25.0
"""Pairs of cells farther apart than this add nothing."""


@nb.njit(cache=True, nogil=True)
def score(  # noqa: C901 - one nest of loops over cells and their neighbours
    rotation: Array,
    shift: Array,
    pivot: Array,
    means: Array,
    covariances: Array,
    grids: Array,
    low: Array,
    cell: float,
    other_means: Array,
    other_covariances: Array,
    derivatives: Array,
    wanted: bool,
) -> float:
    """Sum exp(-q/2) over pairs of cells, q = m' (C + R S R')^-1 m with m between the means; gradient and Hessian.

    Parameters
    ----------
    rotation, shift
        (3, 3) and (3,) target from source [m].
    pivot
        (3,) place in the target about which the pose is turned [m].
    means, covariances
        (n, 3) and (n, 3, 3) of the source's cells [m, m²].
    grids, low, cell
        Numbers of the target's cells in grids that are shifted by half a cell each, -1 where there is none; lower
        corner (3,) of the first and edge of the cells [m].
    other_means, other_covariances
        (m, 3) and (m, 3, 3) of the target's cells.
    derivatives
        (13, 6) is filled, where it is wanted, with the gradient by (turn, shift), the Hessian, and the sum of the outer
        products of the single source cells' gradients.
    wanted
        Whether derivatives are.

    Returns
    -------
    The score.
    """
    total = 0.0
    turns = _generators()
    derivatives[:] = 0.0
    # derivatives of a source cell's place and covariance by small turns, first and second
    turned, bent, arms, bends = np.empty((3, 3, 3)), np.empty((3, 3, 3, 3)), np.zeros((6, 3)), np.empty((3, 3, 3))
    own, gap, pull, precision = np.empty(6), np.empty(3), np.empty(3), np.empty((3, 3))
    slopes, leans, stiff = np.empty(6), np.empty((3, 3)), np.empty((6, 3))
    for n in range(len(means)):
        place = rotation @ means[n] + shift
        spread = rotation @ covariances[n] @ rotation.T
        if wanted:
            _prepare(turns, place - pivot, spread, arms, bends, turned, bent)
        own[:] = 0.0
        for g in range(grids.shape[0]):
            x, y, z = _around(place, low, cell, 0.5 * g, grids)
            for i in range(max(x - 1, 0), min(x + 2, grids.shape[1])):
                for j in range(max(y - 1, 0), min(y + 2, grids.shape[2])):
                    for m in grids[g, i, j, max(z - 1, 0) : max(min(z + 2, grids.shape[3]), 0)]:
                        if m < 0:
                            continue
                        for a in range(3):
                            gap[a] = place[a] - other_means[m, a]
                        _invert(spread, other_covariances[m], precision)
                        _times(precision, gap, pull)
                        q = _dot(pull, gap)
                        if q < 2.0 * FARTHEST_EXPONENT:
                            e = math.exp(-0.5 * q)
                            total += e
                            if wanted:
                                _add(
                                    e,
                                    pull,
                                    precision,
                                    arms,
                                    bends,
                                    turned,
                                    bent,
                                    slopes,
                                    leans,
                                    stiff,
                                    own,
                                    derivatives,
                                )
        if wanted:
            derivatives[0] += own
            derivatives[7:] += np.outer(own, own)
    return total


@nb.njit(cache=True, nogil=True)
def _generators() -> Array:
    """Give the derivatives of a rotation by its three small turns, at none."""
    turns = np.zeros((3, 3, 3))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        turns[a, c, b], turns[a, b, c] = 1.0, -1.0
    return turns


@nb.njit(cache=True, nogil=True, inline="always")
def _around(place: Array, low: Array, cell: float, shifted: float, grids: Array) -> tuple[int, int, int]:
    """Give the cell of a place, or one far outside of the grid."""
    x = math.floor((place[0] - low[0]) / cell + shifted)
    y = math.floor((place[1] - low[1]) / cell + shifted)
    z = math.floor((place[2] - low[2]) / cell + shifted)
    if min(x, y, z) < -1 or x > grids.shape[1] or y > grids.shape[2] or z > grids.shape[3]:
        return -9, -9, -9
    return x, y, z


@nb.njit(cache=True, nogil=True)
def _prepare(
    generators: Array, arm: Array, spread: Array, arms: Array, bends: Array, turned: Array, bent: Array
) -> None:
    """Give the derivatives of a cell's place and covariance by small turns, first and second."""
    for a in range(3):
        arms[a] = generators[a] @ arm
        arms[3 + a] = 0.0
        arms[3 + a, a] = 1.0
        half = generators[a] @ spread
        turned[a] = half + half.T
    for a in range(3):
        for b in range(3):
            both = 0.5 * (generators[a] @ generators[b] + generators[b] @ generators[a])
            bends[a, b] = both @ arm
            outer = both @ spread
            inner = generators[a] @ spread @ generators[b].T
            bent[a, b] = outer + outer.T + inner + inner.T


@nb.njit(cache=True, nogil=True)
def _add(
    e: float,
    pull: Array,
    precision: Array,
    arms: Array,
    bends: Array,
    turned: Array,
    bent: Array,
    slopes: Array,
    leans: Array,
    stiff: Array,
    own: Array,
    derivatives: Array,
) -> None:
    """Add what one pair of cells contributes to gradient and Hessian; slopes, leans and stiff are room to work in."""
    for a in range(6):
        _times(precision, arms[a], stiff[a])
        slopes[a] = 2.0 * (pull[0] * arms[a, 0] + pull[1] * arms[a, 1] + pull[2] * arms[a, 2])
        if a < 3:
            _times(turned[a], pull, leans[a])
            slopes[a] -= pull[0] * leans[a, 0] + pull[1] * leans[a, 1] + pull[2] * leans[a, 2]
        own[a] -= 0.5 * e * slopes[a]
    for a in range(6):
        for b in range(a, 6):
            curve = 2.0 * _dot(arms[a], stiff[b])
            if a < 3:
                curve -= 2.0 * _dot(leans[a], stiff[b])
            if b < 3:
                curve -= 2.0 * _dot(leans[b], stiff[a])
            if a < 3 and b < 3:
                curve += 2.0 * _dot(pull, bends[a, b])
                curve += 2.0 * _form(leans[a], precision, leans[b])
                curve -= _form(pull, bent[a, b], pull)
            value = e * (0.25 * slopes[a] * slopes[b] - 0.5 * curve)
            derivatives[1 + a, b] += value
            if b > a:
                derivatives[1 + b, a] += value


@nb.njit(cache=True, nogil=True, inline="always")
def _dot(a: Array, b: Array) -> float:
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@nb.njit(cache=True, nogil=True, inline="always")
def _times(matrix: Array, vector: Array, product: Array) -> None:
    for i in range(3):
        product[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@nb.njit(cache=True, nogil=True, inline="always")
def _form(a: Array, matrix: Array, b: Array) -> float:
    total = 0.0
    for i in range(3):
        total += a[i] * (matrix[i, 0] * b[0] + matrix[i, 1] * b[1] + matrix[i, 2] * b[2])
    return total


@nb.njit(cache=True, nogil=True)
def _invert(first: Array, second: Array, inverse: Array) -> None:
    """Invert the sum of two symmetric positive definite matrices (3, 3) by its cofactors."""
    xx, xy, xz = first[0, 0] + second[0, 0], first[0, 1] + second[0, 1], first[0, 2] + second[0, 2]
    yy, yz, zz = first[1, 1] + second[1, 1], first[1, 2] + second[1, 2], first[2, 2] + second[2, 2]
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    scale = 1.0 / (xx * a + xy * b + xz * c)
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = a * scale, (xx * zz - xz * xz) * scale, (xx * yy - xy * xy) * scale
    inverse[0, 1] = inverse[1, 0] = b * scale
    inverse[0, 2] = inverse[2, 0] = c * scale
    inverse[1, 2] = inverse[2, 1] = (xy * xz - xx * yz) * scale
