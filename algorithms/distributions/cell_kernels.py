"""Loops over cells of the normal distributions transform in space, compiled."""

import math

import numba as nb
import numpy as np

from algorithms.arrays import Array

FARTHEST_EXPONENT = 12.0
"""Pairs of cells farther apart than this, which would add less than a hundred-thousandth, add nothing."""


@nb.njit(cache=True, nogil=True)
def score(  # noqa: C901, PLR0912 - one nest of loops over cells and their neighbours
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
    derivatives[:] = 0.0
    own, place, arm, gap, pull = np.empty(6), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    half, spread, precision = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    crossed, drawn, moved, stiff = np.zeros((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(means)):
        _times(rotation, means[n], place)
        for a in range(3):
            place[a] += shift[a]
            arm[a] = place[a] - pivot[a]
            _times(covariances[n], rotation[a], half[a])
        for a in range(3):
            _times(rotation, half[a], spread[a])
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
                                _add(e, pull, precision, spread, arm, crossed, drawn, moved, stiff, own, derivatives)
        for a in range(6):
            derivatives[0, a] += own[a]
            for b in range(6):
                derivatives[7 + a, b] += own[a] * own[b]
    for a in range(6):
        for b in range(a):
            derivatives[1 + a, b] = derivatives[1 + b, a]
    return total


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
def _add(
    e: float,
    pull: Array,
    precision: Array,
    spread: Array,
    arm: Array,
    crossed: Array,
    drawn: Array,
    moved: Array,
    stiff: Array,
    own: Array,
    derivatives: Array,
) -> None:
    """Add what one pair of cells contributes to the gradient, and to the upper half of the Hessian.

    With p = P m of the precision P = (C + S)^-1, the spread S of the source's cell in the target, its arm v from the
    pivot, u = v - S p, and unit vectors g_a: -q/2 has the gradient -(u x p, p) by (turn, shift), and q/2 the Hessian
    J'PJ + (p_a u_b + p_b u_a)/2 - d_ab p.u - (g_a x p)' S (g_b x p) by turns, PJ by turn and shift, P by shifts, where
    J_a = g_a x u + S (g_a x p). `crossed`, `drawn`, `moved` and `stiff` are room for g_a x p (whose diagonal is zero),
    S (g_a x p), J and PJ, by rows.
    """
    ux, uy, uz = arm[0] - _dot(spread[0], pull), arm[1] - _dot(spread[1], pull), arm[2] - _dot(spread[2], pull)
    u = (ux, uy, uz)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        crossed[a, b], crossed[a, c] = -pull[c], pull[b]
        _times(spread, crossed[a], drawn[a])
        moved[a, a], moved[a, b], moved[a, c] = drawn[a, a], drawn[a, b] - u[c], drawn[a, c] + u[b]
        _times(precision, moved[a], stiff[a])
    t = (
        uy * pull[2] - uz * pull[1],
        uz * pull[0] - ux * pull[2],
        ux * pull[1] - uy * pull[0],
        pull[0],
        pull[1],
        pull[2],
    )
    along = ux * pull[0] + uy * pull[1] + uz * pull[2]
    for a in range(6):
        own[a] -= e * t[a]
        for b in range(a, 6):
            if b < 3:
                bend = 0.5 * (pull[a] * u[b] + pull[b] * u[a]) - (along if a == b else 0.0)
                curve = _dot(moved[a], stiff[b]) + bend - _dot(crossed[a], drawn[b])
            elif a < 3:
                curve = stiff[a, b - 3]
            else:
                curve = precision[a - 3, b - 3]
            derivatives[1 + a, b] += e * (t[a] * t[b] - curve)


@nb.njit(cache=True, nogil=True, inline="always")
def _dot(a: Array, b: Array) -> float:
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@nb.njit(cache=True, nogil=True, inline="always")
def _times(matrix: Array, vector: Array, product: Array) -> None:
    for i in range(3):
        product[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


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
