"""Finding wrong correspondences: one at a time, adjusted anew, re-tested and put back (MATH 4.5)."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import TypeAlias

import numpy as np
from scipy import stats

from algorithms.adjustment.problem import AnyProblem, Problem
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.testing import BlockTests, block_tests, predicted_block_tests
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, Flags

FEWEST_BLOCKS = 2
"""Correspondences that must remain."""

INSEPARABLE = 0.9
"""Above this correlation of two test values either could be the wrong one (MATH 4.5)."""

Adjust: TypeAlias = Callable[[AnyProblem, Unknowns], Solution]
"""Adjusts observations from start values, each time with the datum or rank that they allow."""

MEDIAN_SPREAD = 1.15
"""Standard deviation of sqrt(n) times the median of n values of T over its expectation, three degrees of freedom."""


class CorrespondenceState(IntEnum):
    """What became of a correspondence."""

    USED = 0
    REMOVED = 1
    REINSTATED = 2
    """Removed in between, found good in the end, and used."""
    NOT_CONTROLLED = 3
    """Used, but nothing checks it."""


class Change(StrEnum):
    """Direction of a change of the set of used correspondences."""

    REMOVED = "removed"
    REINSTATED = "reinstated"


@dataclass(frozen=True)
class SnoopingStep:
    """One change of the set of used correspondences."""

    step: int
    """Number of the adjustment after which it happened, from 1."""
    change: Change
    block: int
    """Number of the correspondence."""
    statistic: float
    """Its test value T."""
    critical: float
    """Limit of T."""
    inseparable_from: tuple[int, ...]
    """Correspondences whose test values are correlated with this one's by more than 0.9: any may be the wrong one."""


@dataclass(frozen=True, eq=False)
class SnoopingResult:
    """Solution without the correspondences that failed the test."""

    solution: Solution
    used: Flags
    """(n,) True for correspondences in the solution."""
    reinstated: Flags
    """(n,) True for those that had been out and came back."""
    tests: BlockTests
    """Tests of all correspondences, of unused ones against their prediction; T is divided by `variance_factor`."""
    variance_factor: float
    """What single tests allow for, at least 1."""
    steps: tuple[SnoopingStep, ...]


@dataclass(frozen=True)
class SnoopingRules:
    """When to remove and when to stop."""

    alpha: float
    """Probability that a good correspondence fails its test."""
    max_removed_share: float
    """No more than this share of the correspondences is removed; 0 tests without removing."""
    robust_variance: bool = False
    """Whether tests allow for a variance factor estimated robustly from all correspondences."""


def adjust_and_snoop(
    problem: AnyProblem,
    start: Unknowns,
    rules: SnoopingRules,
    adjust: Adjust[AnyProblem],
    suspicious: Flags | None = None,
) -> SnoopingResult:
    """Adjust, remove the worst correspondence while one fails, re-test the removed ones and put back the good.

    Parameters
    ----------
    problem
        All correspondences or observations.
    start
        Start values.
    rules
        Significance level and limits.
    adjust
        Adjusts a selection of them.
    suspicious
        (number of blocks,) True for those that are out at first (`robust_adjustment`); good ones come back.
    """
    result = _snooped(problem, start, rules, adjust, 1.0, suspicious)
    if not rules.robust_variance or result.used.all():
        return result
    factor = robust_variance_factor(result.tests)
    return result if factor == 1.0 else _snooped(problem, result.solution.unknowns, rules, adjust, factor, suspicious)


def _snooped(
    problem: AnyProblem,
    start: Unknowns,
    rules: SnoopingRules,
    adjust: Adjust[AnyProblem],
    factor: float,
    suspicious: Flags | None,
) -> SnoopingResult:
    """Snoop with tests that allow for a variance factor."""
    n = len(problem)
    used = np.ones(n, dtype=bool) if suspicious is None else ~suspicious
    reinstated = np.zeros(n, dtype=bool)
    most_removed = min(int(rules.max_removed_share * n), n - FEWEST_BLOCKS)
    steps: list[SnoopingStep] = []
    values, adjustments = start, 0
    while True:
        part = problem if used.all() else problem.selected(used)
        solution = adjust(part, values)
        adjustments += 1
        values = solution.unknowns
        tests = _all_tests(problem, used, solution).with_variance(factor)
        # What has been put back stays: so the loop ends.
        candidates = np.where(used & ~reinstated, tests.p_values, np.inf)
        worst = _worst(candidates, tests)
        if candidates[worst] < rules.alpha and (~used).sum() < most_removed:
            partners = _inseparable(solution, int(used[:worst].sum()), np.flatnonzero(used))
            steps.append(_step(adjustments, Change.REMOVED, worst, tests, rules.alpha, partners))
            used[worst] = False
            continue
        best = int(np.argmax(np.where(used, -1.0, tests.p_values)))
        if not used[best] and tests.degrees[best] > 0 and tests.p_values[best] >= rules.alpha:
            steps.append(_step(adjustments, Change.REINSTATED, best, tests, rules.alpha, ()))
            used[best] = reinstated[best] = True
            continue
        return SnoopingResult(solution, used, reinstated, tests, factor, tuple(steps))


def robust_variance_factor(tests: BlockTests) -> float:
    """Estimate the variance factor from the median of T over its expected median, blunders notwithstanding.

    Parameters
    ----------
    tests
        Of all correspondences in a pose that blunders do not bend; removed ones count too.

    Returns
    -------
    The factor; 1 where the median does not clearly contradict the a-priori variances (by two of its own standard
    deviations).
    """
    controlled = tests.degrees > 0
    if not controlled.any():
        return 1.0
    factor = float(np.median(tests.statistics[controlled] / stats.chi2.median(tests.degrees[controlled])))
    return factor if factor > 1.0 + 2.0 * MEDIAN_SPREAD / np.sqrt(controlled.sum()) else 1.0


def _all_tests(problem: Problem, used: Flags, solution: Solution) -> BlockTests:
    """Put the tests of used and the predictions of unused correspondences into one."""
    inside = block_tests(solution)
    if used.all():
        return inside
    outside = predicted_block_tests(problem, used, solution)
    merged = [np.array(values) for values in (outside.statistics, outside.degrees, outside.p_values)]
    for values, of_used in zip(merged, (inside.statistics, inside.degrees, inside.p_values), strict=True):
        values[used] = of_used
    return BlockTests(*merged)


def _worst(p_values: Array, tests: BlockTests) -> int:
    """Find the smallest p-value; among those too small for a number, the largest statistic per degree of freedom."""
    smallest = p_values.min()
    ties = np.flatnonzero(p_values <= max(smallest, np.finfo(np.float64).tiny))
    ratio = tests.statistics[ties] / np.maximum(tests.degrees[ties], 1.0)
    return int(ties[np.argmax(ratio)])


def _step(
    number: int, change: Change, block: int, tests: BlockTests, alpha: float, partners: tuple[int, ...]
) -> SnoopingStep:
    critical = float(stats.chi2.isf(alpha, max(tests.degrees[block], 1.0)))
    return SnoopingStep(number, change, block, float(tests.statistics[block]), critical, partners)


def _inseparable(solution: Solution, block: int, numbers: Array) -> tuple[int, ...]:
    """Find blocks whose residuals are bound to those of one block (largest canonical correlation)."""
    system = solution.system
    rows_of = system.block_of_row
    mine = np.flatnonzero(rows_of == block)
    jacobian = system.jacobian.toarray()
    crossed = -jacobian[mine] @ solution.cofactors @ jacobian.T
    if system.joint_covariance is not None:
        crossed = crossed + system.joint_covariance[mine]
    roots = _residual_roots(solution)
    found = []
    for other in range(len(numbers)):
        if other == block:
            continue
        rows = np.flatnonzero(rows_of == other)
        correlation = roots[block] @ crossed[:, rows] @ roots[other].T
        if np.linalg.norm(correlation, ord=2) > INSEPARABLE:
            found.append(int(numbers[other]))
    return tuple(found)


def _residual_roots(solution: Solution) -> list[Array]:
    """Give for each block a matrix that whitens its residuals after adjustment, uncontrolled parts left out."""
    system, roots = solution.system, []
    for blocks, jacobians in zip(system.covariances, system.split(system.jacobian.toarray()), strict=True):
        left = blocks - jacobians @ solution.cofactors @ np.swapaxes(jacobians, 1, 2)
        values, vectors = np.linalg.eigh(left)
        relative = values / np.maximum(values[:, -1:], np.finfo(np.float64).tiny)
        inverse = np.where(relative > 1e-10, 1.0 / np.sqrt(np.where(relative > 1e-10, values, 1.0)), 0.0)
        roots.extend(inverse[:, :, None] * np.swapaxes(vectors, 1, 2))
    return roots
