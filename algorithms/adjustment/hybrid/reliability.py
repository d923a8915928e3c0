"""Tests and reliability of every observation of a hybrid network, from the selected inverse (MATH 4.1 to 4.4)."""

from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.hybrid.estimation import Estimate
from algorithms.adjustment.hybrid.network import Network
from algorithms.adjustment.testing import NOT_CONTROLLED, noncentrality
from algorithms.arrays import Array, Flags, Indices
from algorithms.probabilities import chi2_sf

SINGULAR_SHARE = 1e-6
MOST_ROWS = 600
"""Objects of more observations are not tested as a whole: their own covariance would be large and dense."""


@dataclass(frozen=True, eq=False)
class ObservationTests:
    """Every residual and every observation (block of residuals with a common covariance)."""

    w: Array
    """(m,) standardised test values with sigma0 = 1; 0 where not controlled; of unused ones those of the prediction."""
    redundancy: Array
    """(m,) redundancy numbers; 0 for unused ones."""
    controlled: Flags
    """(m,) False where an error cannot be seen."""
    detectable: Array
    """(m,) smallest error found with the given power, in the observation's unit; inf where not controlled."""
    statistics: Array
    """(blocks,) T."""
    degrees: Array
    """(blocks,) its degrees of freedom."""
    p_values: Array
    """(blocks,) probability of a larger T in a good observation; 1 where not controlled."""


def observation_tests(network: Network, found: Estimate, scales: Array, alpha: float, power: float) -> ObservationTests:
    """Compute w, r, smallest detectable errors, and T of observations with several components (MATH 4.2).

    Parameters
    ----------
    network
        Observations.
    found
        Their adjustment; used rows have the weight 1/scale².
    scales
        (m,) factors on the a-priori standard deviations.
    alpha, power
        Of a single test, for the smallest detectable error.
    """
    jacobian, m = found.linearised.jacobian, len(scales)
    used = found.weights > 0.0
    sign = np.where(used, -1.0, 1.0)  # of unused ones the predicted value has a variance too
    blocks = network.sizes
    w, redundancy = np.zeros(m), np.zeros(m)
    detectable = np.full(m, np.inf)
    controlled = np.zeros(m, dtype=bool)
    statistics, degrees = np.zeros(len(blocks)), np.zeros(len(blocks), dtype=np.int64)
    rows = np.arange(m, dtype=np.int64)
    residuals = found.linearised.residuals / scales
    delta0 = noncentrality(alpha, power)

    single = blocks[network.block_of_row] == 1
    at = rows[single]
    left = 1.0 + sign[at] * found.factor.row_products(jacobian, at, at) / np.square(scales[at])
    seen = left > NOT_CONTROLLED
    roots = np.sqrt(np.where(seen, left, 1.0))
    controlled[at] = seen
    redundancy[at] = np.where(used[at], left, 0.0)
    w[at] = np.where(seen, residuals[at] / roots, 0.0)
    detectable[at] = np.where(seen, delta0 * network.stds[at] * scales[at] / roots, np.inf)
    of = network.block_of_row[at]
    statistics[of], degrees[of] = np.square(w[at]), seen

    for k, (each, whitener) in enumerate(zip(network.observations, network.whiteners, strict=True)):
        if each.size == 1 or not len(each):
            continue
        d = each.size
        first = network.first_blocks[k]
        numbers = network.first_rows[first] + np.arange(len(each) * d).reshape(len(each), d)
        one = np.broadcast_to(numbers[:, :, None], (len(each), d, d))
        products = found.factor.row_products(jacobian, one.ravel(), np.swapaxes(one, 1, 2).ravel()).reshape(-1, d, d)
        factors = np.square(scales[numbers])[:, :, None]
        spread = np.eye(d) + sign[numbers][:, :, None] * products / factors
        values, vectors = np.linalg.eigh(0.5 * (spread + np.swapaxes(spread, 1, 2)))
        turned = np.einsum("nji,nj->ni", vectors, residuals[numbers])
        good = values > NOT_CONTROLLED
        span = slice(int(first), int(first) + len(each))
        statistics[span] = np.where(good, turned**2 / np.where(good, values, 1.0), 0.0).sum(axis=1)
        degrees[span] = good.sum(axis=1)
        # Baarda's general form: w = (P v)_k / sqrt((P Qvv P)_kk), r = (Qvv P)_kk
        white = whitener / scales[numbers][:, :, None]
        weighted = np.einsum("nji,nj->ni", white, residuals[numbers])
        reduced = np.einsum("nji,njk,nki->ni", white, spread, white)
        weight = np.einsum("nji,nji->ni", white, white)
        seen_here = reduced > NOT_CONTROLLED * weight
        root = np.sqrt(np.where(seen_here, reduced, 1.0))
        w[numbers] = np.where(seen_here, weighted / root, 0.0)
        controlled[numbers] = seen_here
        detectable[numbers] = np.where(seen_here, delta0 / root, np.inf)
        shares = np.einsum("nij,nji->ni", np.linalg.solve(white, spread), white)
        redundancy[numbers] = np.where(used[numbers], shares, 0.0)
    p_values = np.where(degrees > 0, chi2_sf(statistics, np.maximum(degrees, 1)), 1.0)
    return ObservationTests(w, redundancy, controlled, detectable, statistics, degrees, p_values)


@dataclass(frozen=True)
class ObjectTest:
    """Several observations together: all of a point, of a scan, of a photo (MATH 4.4)."""

    statistic: float
    degrees_of_freedom: int
    p_value: float


def object_test(found: Estimate, rows: Indices, scales: Array) -> ObjectTest | None:
    """Test rows as a whole, T = lᵀ S⁻¹ l with S = I - A Q Aᵀ; the drop of Omega if all were left out (MATH 4.2).

    Parameters
    ----------
    found
        An adjustment in which they took part.
    rows
        (k,) of the rows.
    scales
        (m,) factors on the a-priori standard deviations.

    Returns
    -------
    The test, or None where nothing is controlled, or there are too many rows.
    """
    if not 0 < len(rows) <= MOST_ROWS:
        return None
    part = np.asarray(found.linearised.jacobian[rows].toarray()) / scales[rows][:, None]
    concerned = np.flatnonzero((part != 0.0).any(axis=0))
    right = np.ascontiguousarray(part.T)
    spread = np.eye(len(rows)) - part[:, concerned] @ found.factor.solved(right)[concerned]
    values, vectors = np.linalg.eigh(0.5 * (spread + spread.T))
    seen = values > SINGULAR_SHARE
    if not seen.any():
        return None
    turned = vectors[:, seen].T @ (found.linearised.residuals[rows] / scales[rows])
    statistic = float((turned**2 / values[seen]).sum())
    degrees = int(seen.sum())
    return ObjectTest(statistic, degrees, float(chi2_sf(statistic, degrees)))
