"""Which points moved between two epochs: congruence test, and localisation by leaving points out of the datum.

Pelzer, Zur Analyse geodätischer Deformationsmessungen (1971); Niemeier, Ausgleichungsrechnung (2008), ch. 11.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from algorithms.arrays import Array, Flags, Points, Scalars
from algorithms.probabilities import chi2_sf

SINGULAR_SHARE = 1e-10


@dataclass(frozen=True, eq=False)
class Congruence:
    """Test of the common form of two epochs."""

    statistic: float
    degrees_of_freedom: int
    p_value: float
    moved: Flags
    """(n,) points that do not belong to the common form."""
    order: tuple[int, ...]
    """Moved points in the order in which they were found."""
    remaining_statistic: float
    remaining_degrees_of_freedom: int
    displacements: Points
    """(n, 3) in the datum of the points that did not move [m]."""
    covariances: Array
    """(n, 3, 3) [m²]."""
    statistics: Scalars
    """(n,) T of each displacement, three degrees of freedom."""


def congruence(differences: Points, covariance: Array, basis: Array, alpha: float) -> Congruence:
    """Test whether the differences of n points are common motions plus noise, and find those that are not (MATH 4.4).

    The point whose leaving the datum lowers T of the others most is taken for moved, until the others are congruent.

    Parameters
    ----------
    differences
        (n, 3) later minus earlier [m].
    covariance
        (3n, 3n) of the differences, in any datum [m²].
    basis
        (3n, d) motions that the datums leave free; d = 0: none.
    alpha
        Probability that congruent epochs fail.
    """
    n = len(differences)
    stable = np.ones(n, dtype=bool)
    order: list[int] = []
    first = _congruent(differences, covariance, basis, stable)
    now = first
    d = basis.shape[1]
    while now[1] > 0 and chi2_sf(*now) < alpha and 3 * (int(stable.sum()) - 1) > d:
        left = []
        for k in np.flatnonzero(stable):
            stable[k] = False
            left.append((_congruent(differences, covariance, basis, stable), int(k)))
            stable[k] = True
        now, worst = min(left, key=lambda each: each[0][0])
        stable[worst] = False
        order.append(worst)
    moved_differences, moved_covariance = _in_datum(differences, covariance, basis, stable)
    blocks = np.array([moved_covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(n)]).reshape(n, 3, 3)
    statistics = np.array([
        _quadratic(difference, block)[0] for difference, block in zip(moved_differences, blocks, strict=True)
    ])  # fmt: skip
    return Congruence(
        first[0], first[1], float(chi2_sf(*first)) if first[1] else 1.0, ~stable, tuple(order), now[0], now[1],
        moved_differences, blocks, statistics,
    )  # fmt: skip


def _congruent(differences: Points, covariance: Array, basis: Array, stable: Flags) -> tuple[float, int]:
    moved, spread = _in_datum(differences, covariance, basis, stable)
    rows = np.repeat(stable, 3)
    return _quadratic(moved.ravel()[rows], spread[np.ix_(rows, rows)])


def _in_datum(differences: Points, covariance: Array, basis: Array, stable: Flags) -> tuple[Points, Array]:
    """Carry differences and covariance into the datum of the stable points, S = I - B (FᵀB)⁻¹ Fᵀ (MATH 6.2)."""
    if basis.shape[1] == 0:
        return differences, covariance
    chosen = basis * np.repeat(stable, 3)[:, None]
    carried = np.eye(len(basis)) - basis @ np.linalg.pinv(chosen.T @ basis) @ chosen.T
    return (carried @ differences.ravel()).reshape(-1, 3), carried @ covariance @ carried.T


def _quadratic(vector: Array, covariance: Array) -> tuple[float, int]:
    values, vectors = linalg.eigh(0.5 * (covariance + covariance.T))
    seen = values > SINGULAR_SHARE * max(float(values[-1]), np.finfo(np.float64).tiny)
    turned = vectors[:, seen].T @ vector
    return float((turned**2 / values[seen]).sum()), int(seen.sum())
