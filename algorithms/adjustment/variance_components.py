"""Variance components: one factor for the standard deviations of each group of observations (MATH 4.7)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.adjustment.problem import AnyProblem
from algorithms.adjustment.snooping import Adjust, adjusted
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.testing import redundancy_numbers
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array
from algorithms.errors import InvalidInputError

UNIT = 0.01
"""Factors within this of 1 are settled."""

LEAST_REDUNDANCY = 10.0
"""A group with less redundancy does not tell its own variance (MATH 4.7)."""


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """Factors on the a-priori standard deviations of groups, and the adjustment with them."""

    factors: Float64[Array, "groups"]
    """s_g: standard deviation that the residuals support over the a-priori one; 1 where it is not estimated."""
    factor_stds: Float64[Array, "groups"]
    """Standard deviation of the last factor, s_g/sqrt(2 r_g); inf where the group has no redundancy."""
    redundancies: Float64[Array, "groups"]
    """r_g, sum of the group's redundancy numbers."""
    estimated: Float64[Array, "groups"]
    """1 where the factor was estimated, 0 where the redundancy is below 10."""
    rounds: int
    converged: bool
    solution: Solution
    """With the a-posteriori standard deviations; their sigma0 stays fixed at 1."""


@dataclass(frozen=True, eq=False)
class GroupFigures:
    """What an adjustment tells of each group (ORIENT's table of S_gr)."""

    counts: Int64[Array, "groups"]
    """Residuals."""
    omegas: Float64[Array, "groups"]
    """Share of the weighted sum of squared residuals."""
    redundancies: Float64[Array, "groups"]
    """Sum of redundancy numbers."""

    @property
    def factors(self) -> Float64[Array, "groups"]:
        """S_gr = sqrt(Omega_g / r_g); 1 where the group has no redundancy."""
        has = self.redundancies > 0.0
        return np.sqrt(np.where(has, self.omegas, 1.0) / np.where(has, self.redundancies, 1.0))


def group_figures(solution: Solution, groups: Int64[Array, "blocks"], count: int) -> GroupFigures:
    """Sum residuals and redundancy numbers over groups (MATH 4.7).

    Parameters
    ----------
    solution
        An adjustment.
    groups
        (number of blocks,) group of each block of the adjustment.
    count
        Number of groups.
    """
    system, whitening = solution.system, solution.whitening
    of_row = groups[system.block_of_row]
    weighted = whitening.apply_transposed(whitening.apply(system.residuals))
    return GroupFigures(
        np.bincount(of_row, minlength=count),
        np.bincount(of_row, system.residuals * weighted, count),
        np.bincount(of_row, redundancy_numbers(solution), count),
    )


def estimate_variance_components(
    problem: AnyProblem,
    groups: Int64[Array, "blocks"],
    start: Unknowns,
    adjust: Adjust[AnyProblem],
    *,
    max_rounds: int = 30,
) -> VarianceComponents:
    """Multiply the standard deviations of each group by s_g = sqrt(Omega_g/r_g) until all s_g are 1 (Foerstner 1979).

    Only after gross errors are out: each of them would enlarge its group. Groups whose redundancy is below 10 keep
    their a-priori standard deviations.

    Parameters
    ----------
    problem
        Observations without gross errors.
    groups
        (number of blocks,) group of each block, from 0.
    start
        Start values.
    adjust
        Adjusts the observations.
    max_rounds
        Limit of rounds.

    Raises
    ------
    InvalidInputError
        When the number of groups' entries is not that of the blocks.
    """
    if len(groups) != len(problem):
        raise InvalidInputError("groups", f"{len(groups)} entries for {len(problem)} observations", "name each once")
    count = int(groups.max(initial=-1)) + 1
    factors = np.ones(count)
    solution = adjusted(problem, start, adjust)
    figures = group_figures(solution, groups, count)
    for rounds in range(1, max_rounds + 1):
        estimated = figures.redundancies >= LEAST_REDUNDANCY
        change = np.where(estimated, figures.factors, 1.0)
        settled = bool((np.abs(change - 1.0) < UNIT).all())
        if settled or rounds == max_rounds:
            break
        factors = factors * change
        solution = adjusted(problem.scaled(factors[groups]), solution.unknowns, adjust)
        figures = group_figures(solution, groups, count)
    redundancies = figures.redundancies
    spread = np.where(redundancies > 0.0, factors / np.sqrt(2.0 * np.maximum(redundancies, 1e-300)), np.inf)
    return VarianceComponents(factors, spread, redundancies, estimated.astype(np.float64), rounds, settled, solution)


def helmert_factors(solution: Solution, groups: Int64[Array, "blocks"], count: int) -> Float64[Array, "groups"]:
    """Give one round of Helmert's full form, S s² = Omega, for independent blocks (MATH 4.7).

    S_gh = tr(Q N_g Q N_h) for g != h, S_gg = n_g - 2 tr(Q N_g) + tr(Q N_g Q N_g). Its row sums are the redundancies, so
    Foerstner's form (`estimate_variance_components`) has the same fixed point.

    Parameters
    ----------
    solution
        Adjustment of independent blocks.
    groups, count
        Group of each block, and their number.

    Raises
    ------
    InvalidInputError
        When blocks are correlated: their groups have no normal matrices of their own.
    """
    system, whitening = solution.system, solution.whitening
    if system.joint_covariance is not None:
        raise InvalidInputError("groups", "observations of different groups are correlated", "use Foerstner's form")
    of_row = groups[system.block_of_row]
    jacobian = whitening.apply(system.dense_jacobian)
    residuals = whitening.apply(system.residuals)
    shares = []
    for g in range(count):
        rows = jacobian[of_row == g]
        shares.append(solution.cofactors @ (rows.T @ rows))
    matrix = np.array([[np.sum(one * other.T) for other in shares] for one in shares])
    matrix += np.diag(np.bincount(of_row, minlength=count) - 2.0 * np.array([np.trace(share) for share in shares]))
    return np.sqrt(np.linalg.solve(matrix, np.bincount(of_row, residuals**2, count)))
