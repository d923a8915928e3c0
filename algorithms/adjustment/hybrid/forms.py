"""Where a network is weak: principal components of its points, correlated unknowns, effects of undetected errors."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from algorithms.adjustment.hybrid.datum import Cofactors
from algorithms.adjustment.hybrid.estimation import Estimate
from algorithms.arrays import Array

MOST_DENSE = 600
"""Up to so many coordinates all eigenvalues are computed."""
MOST_PAIRS = 20_000_000
SEED = 1


@dataclass(frozen=True, eq=False)
class Forms:
    """Eigenvectors of the covariance of coordinates."""

    variances: Array
    """(k,) eigenvalues [m²], the largest first."""
    vectors: Array
    """(c, k)."""


def weakest_forms(cofactors: Cofactors, columns: Array, count: int = 3) -> Forms:
    """Give the largest eigenvalues of the covariance of some unknowns, and their vectors (MATH 5.1).

    Parameters
    ----------
    cofactors
        In the datum.
    columns
        (c,) coordinates of points.
    count
        Number of forms.
    """
    c, u = len(columns), len(cofactors.factor.scale)
    count = min(count, c)
    if c == 0:
        return Forms(np.zeros(0), np.zeros((0, 0)))

    def times(vectors: Array) -> Array:
        given = vectors.reshape(c, -1)
        full = np.zeros((u, given.shape[1]))
        full[columns] = given
        return np.asarray(cofactors.times(full)[columns])

    if c <= MOST_DENSE:
        values, vectors = np.linalg.eigh(_symmetric(times(np.eye(c))))
    else:
        operator = LinearOperator((c, c), matvec=times, matmat=times, dtype=np.float64)
        start = np.random.default_rng(SEED).normal(size=c)
        values, vectors = eigsh(operator, k=count, which="LA", v0=start, tol=1e-6)
    order = np.argsort(values)[::-1][:count]
    return Forms(values[order], vectors[:, order])


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))


def high_correlations(cofactors: Cofactors, determined: Array, limit: float, most: int) -> tuple[Array, Array, Array]:
    """Find unknowns that meet in an observation and are correlated beyond a limit, the most first (MATH 5.1).

    Returns
    -------
    (k,) unknowns, (k,) unknowns, (k,) coefficients; nothing for networks with too many pairs.
    """
    ordering = cofactors.factor.ordering
    if len(ordering.upper_rows) > MOST_PAIRS:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    columns = np.repeat(np.arange(len(ordering.order)), np.diff(ordering.upper_starts))
    off = ordering.upper_rows != columns
    first, second = ordering.order[ordering.upper_rows[off]], ordering.order[columns[off]]
    both = determined[first] & determined[second]
    first, second = first[both], second[both]
    every = np.arange(len(ordering.order))
    spread = np.sqrt(np.maximum(cofactors.elements(every, every), 0.0))
    there = (spread[first] > 0.0) & (spread[second] > 0.0)
    first, second = first[there], second[there]
    found = cofactors.elements(first, second) / (spread[first] * spread[second])
    beyond = np.flatnonzero(np.abs(found) > limit)
    beyond = beyond[np.argsort(-np.abs(found[beyond]))][:most]
    return first[beyond], second[beyond], found[beyond]


def effects_on_points(found: Estimate, cofactors: Cofactors, rows: Array, targets: Array, errors: Array) -> Array:
    """Give how an error of each row moves its own point, dx = Q aᵀ p e, (k, 3) [m] (MATH 4.3).

    Parameters
    ----------
    found
        The adjustment.
    cofactors
        In its datum.
    rows
        (k,) rows of single observations.
    targets
        (k, 3) columns of their points, -1 for constant ones.
    errors
        (k,) errors in standard deviations.
    """
    jacobian = found.linearised.jacobian
    safe = np.maximum(targets, 0)
    gains = found.factor.row_gains(jacobian, rows, safe)
    if cofactors.moving.shape[1]:
        through = np.asarray(jacobian[rows] @ cofactors.crossed)
        gains = gains - np.einsum("kid,kd->ki", cofactors.moving[safe], through)
    gains[targets < 0] = 0.0
    return np.asarray(gains * (errors * found.weights[rows])[:, None])
