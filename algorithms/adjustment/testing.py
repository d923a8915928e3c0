"""Global test, tests of single components and of whole features, and reliability (MATH 4.1 to 4.5)."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from algorithms.adjustment.problem import LinearSystem
from algorithms.adjustment.solver import Solution
from algorithms.arrays import Array, Flags, Matrix, Scalars
from algorithms.probabilities import chi2_isf, chi2_ppf, chi2_sf, norm_isf, norm_ppf, t_isf

NOT_CONTROLLED = 1e-5
"""Below this redundancy share an error cannot be seen at all: no test value, no detectable error."""


class GlobalVerdict(StrEnum):
    """How the weighted squared residuals compare with what the standard deviations promise."""

    ACCEPTED = "accepted"
    TOO_LARGE = "too-large"
    """A gross error, or standard deviations that promise too much."""
    TOO_SMALL = "too-small"
    """Standard deviations that promise too little."""
    NOT_TESTABLE = "not-testable"
    """No redundancy."""


@dataclass(frozen=True)
class GlobalTest:
    """Two-sided test of Omega against chi-square (MATH 4.1)."""

    omega: float
    """Weighted sum of squared residuals, sigma0 = 1."""
    redundancy: int
    """Degrees of freedom."""
    alpha: float
    """Probability of rejecting a good adjustment."""
    lower: float
    """Critical value below."""
    upper: float
    """Critical value above."""
    verdict: GlobalVerdict


@dataclass(frozen=True, eq=False)
class ComponentTests:
    """Every residual by itself, stacked as in the adjustment."""

    w: Scalars
    """(m,) standardised test values with a-priori sigma0 = 1; 0 where not controlled."""
    redundancy: Scalars
    """(m,) redundancy numbers; their sum is the redundancy."""
    controlled: Flags
    """(m,) False where an error cannot be seen."""
    detectable: Scalars
    """(m,) smallest error found with the given power [rad, m]; inf where not controlled."""
    external: Matrix
    """(m, u) effect of an undetected error of that size on the unknowns, of a pair on (rotation vector [rad],
    translation [m]); 0 where not controlled (there it is unbounded)."""


@dataclass(frozen=True, eq=False)
class BlockTests:
    """Every correspondence as a whole, T = rᵀ S⁻¹ r against chi-square (MATH 4.4)."""

    statistics: Scalars
    """(n,) T."""
    degrees: Scalars
    """(n,) degrees of freedom: conditions of the block that the others control, normally 4 of a line."""
    p_values: Scalars
    """(n,) probability of a larger T in a good observation; 1 where nothing is controlled."""

    def selected(self, which: Flags) -> "BlockTests":
        """Keep the tests of some correspondences."""
        return BlockTests(self.statistics[which], self.degrees[which], self.p_values[which])

    def with_variance(self, factor: float) -> "BlockTests":
        """Give the tests for covariances multiplied by a variance factor."""
        statistics = self.statistics / factor
        return BlockTests(statistics, self.degrees, _p_values(statistics, self.degrees))


def global_test(omega: float, redundancy: int, alpha: float) -> GlobalTest:
    """Test Omega two-sided against chi-square with the given redundancy (MATH 4.1)."""
    if redundancy <= 0:
        return GlobalTest(omega, redundancy, alpha, 0.0, 0.0, GlobalVerdict.NOT_TESTABLE)
    lower = float(chi2_ppf(alpha / 2.0, redundancy))
    upper = float(chi2_isf(alpha / 2.0, redundancy))
    verdict = GlobalVerdict.ACCEPTED
    if omega > upper:
        verdict = GlobalVerdict.TOO_LARGE
    elif omega < lower:
        verdict = GlobalVerdict.TOO_SMALL
    return GlobalTest(omega, redundancy, alpha, lower, upper, verdict)


def normal_critical_value(alpha: float) -> float:
    """Give the two-sided limit of w with sigma0 known a priori: 3.291 for 0.1 % (MATH 4.2)."""
    return float(norm_isf(alpha / 2.0))


def tau_critical_value(alpha: float, redundancy: int) -> float | None:
    """Give Pope's limit of w with sigma0 estimated from the same residuals; None below redundancy 2 (MATH 4.2).

    tau = t sqrt(f) / sqrt(f - 1 + t²), t the Student quantile with f - 1 degrees of freedom.
    """
    if redundancy < 2:
        return None
    t = float(t_isf(alpha / 2.0, redundancy - 1))
    return float(t * np.sqrt(redundancy) / np.sqrt(redundancy - 1.0 + t * t))


def noncentrality(alpha: float, power: float) -> float:
    """Give delta0, the shift of a normal test value that is found with the given power (MATH 4.3; Baarda 1968).

    delta0 = z(1 - alpha/2) + z(power): 4.132 for 0.1 % and 80 %.
    """
    return normal_critical_value(alpha) + float(norm_ppf(power))


def redundancy_numbers(solution: Solution) -> Scalars:
    """Give r = diag(Qvv P), (m,); their sum is the redundancy (MATH 4). O(m u)."""
    whitening, system = solution.whitening, solution.system
    jacobian = system.dense_jacobian
    gain = whitening.apply_transposed(whitening.apply(jacobian)) @ solution.cofactors
    return np.asarray(whitening.projector_diagonal(system) - np.einsum("ij,ij->i", jacobian, gain))


def component_tests(solution: Solution, alpha: float, power: float) -> ComponentTests:
    """Compute w, redundancy, smallest detectable errors and their effect on the pose (MATH 4.2, 4.3).

    With correlated residuals in Baarda's general form: w = (P v)_k / sqrt((P Qvv P)_kk), r = (Qvv P)_kk; for
    uncorrelated ones this is v/(sigma sqrt(r)). O(m u) memory.
    """
    whitening, system = solution.whitening, solution.system
    jacobian = system.dense_jacobian
    weighted = whitening.apply_transposed(whitening.apply(system.residuals))
    by_unknowns = whitening.apply_transposed(whitening.apply(jacobian))
    gain = by_unknowns @ solution.cofactors
    weights = whitening.weight_diagonal()
    reduced = weights - np.einsum("ij,ij->i", gain, by_unknowns)
    redundancy = whitening.projector_diagonal(system) - np.einsum("ij,ij->i", jacobian, gain)
    controlled = reduced > NOT_CONTROLLED * weights
    spread = np.sqrt(np.where(controlled, reduced, 1.0))
    detectable = np.where(controlled, noncentrality(alpha, power) / spread, np.inf)
    return ComponentTests(
        w=np.where(controlled, weighted / spread, 0.0),
        redundancy=redundancy,
        controlled=controlled,
        detectable=detectable,
        external=-gain * np.where(controlled, detectable, 0.0)[:, None],
    )


def block_tests(solution: Solution) -> BlockTests:
    """Test each correspondence as a whole with the covariance of its residuals, C - J Q Jᵀ (MATH 4.4)."""
    system = solution.system
    covariances = []
    for blocks, jacobians in zip(system.covariances, system.split(system.dense_jacobian), strict=True):
        covariances.append(blocks - jacobians @ solution.cofactors @ np.swapaxes(jacobians, 1, 2))
    return _tests(system, covariances)


def predicted_block_tests(system: LinearSystem, used: Flags, solution: Solution) -> BlockTests:
    """Test correspondences that took no part against what the solution predicts for them (MATH 4.5).

    Parameters
    ----------
    system
        All correspondences at the solution.
    used
        (number of blocks,) True for those of the solution.
    solution
        Solution of the used ones.

    Returns
    -------
    Tests of all blocks; only those of unused ones are meaningful.
    """
    rows = used[system.block_of_row]
    jacobian = system.dense_jacobian
    gain = np.zeros((jacobian.shape[1], len(rows)))
    gain[:, rows] = solution.gain()
    # Unused lines may share planes with used ones, whose errors are in the unknowns already.
    shared = np.zeros_like(jacobian) if system.joint_covariance is None else system.joint_covariance @ gain.T
    covariances = []
    for blocks, jacobians, common in zip(system.covariances, system.split(jacobian), system.split(shared), strict=True):
        transposed = np.swapaxes(jacobians, 1, 2)
        mixed = jacobians @ np.swapaxes(common, 1, 2)
        through_unknowns = jacobians @ solution.cofactors @ transposed
        covariances.append(blocks + through_unknowns - mixed - np.swapaxes(mixed, 1, 2))
    return _tests(system, covariances)


def _tests(system: LinearSystem, residual_covariances: list[Array]) -> BlockTests:
    statistics, degrees = [], []
    for residuals, own, left in zip(
        system.split(system.residuals), system.covariances, residual_covariances, strict=True
    ):
        inverse_roots = np.linalg.inv(np.linalg.cholesky(own))
        values, vectors = np.linalg.eigh(inverse_roots @ left @ np.swapaxes(inverse_roots, 1, 2))
        turned = np.einsum("nji,njk,nk->ni", vectors, inverse_roots, residuals)
        seen = values > NOT_CONTROLLED
        statistics.append((np.where(seen, turned**2, 0.0) / np.where(seen, values, 1.0)).sum(axis=1))
        degrees.append(seen.sum(axis=1).astype(np.float64))
    t, f = np.concatenate(statistics), np.concatenate(degrees)
    return BlockTests(t, f, _p_values(t, f))


def _p_values(statistics: Scalars, degrees: Scalars) -> Scalars:
    return np.where(degrees > 0, chi2_sf(statistics, np.maximum(degrees, 1.0)), 1.0)
