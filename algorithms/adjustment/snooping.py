"""Finding wrong correspondences: one object at a time, all others re-tested beside it, and put back (MATH 4.5)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from itertools import count
from typing import TypeAlias

import numpy as np
from scipy import special

from algorithms.adjustment.critical_values import b_method_limit
from algorithms.adjustment.gross_errors import GrossErrorSearch, GrossErrorTests, Partner, Plane
from algorithms.adjustment.mount_errors import MountError, may_be_trusted_less, mount_errors, with_less_trust
from algorithms.adjustment.problem import AnyProblem, LinearSystem, Problem
from algorithms.adjustment.solver import LINEAR_STEP, Solution
from algorithms.adjustment.testing import BlockTests, block_tests, predicted_block_tests
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, Flags
from algorithms.probabilities import chi2_ppf

FEWEST_BLOCKS = 2
"""Correspondences that must remain."""

Adjust: TypeAlias = Callable[[AnyProblem, Unknowns, LinearSystem, bool], Solution]
"""Adjusts observations from start values, at which they are linearised already, each time with the datum or rank that
they allow; roughly where figures need not be final (`solve`)."""

FITS_WELL = 0.05
"""Probability of a larger test value above which correspondences that were out come back together: they agree with the
solution so well that none of them moves it by anything that matters to the others."""
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
    """Number of the decision, from 1; a plane goes in one with all that depends on it."""
    change: Change
    block: int
    """Number of the correspondence."""
    statistic: float
    """Its test value T."""
    critical: float
    """Limit of T."""
    inseparable_from: tuple[Partner, ...]
    """Correspondences whose test values are correlated with this one's by more than 0.9: any may be the wrong one."""
    plane: Plane | None = None
    """Plane that was rejected with all that depends on it; None where the correspondence was rejected by itself."""


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
    mounts: tuple[MountError, ...] = ()
    """Mounts of photos that contradict what else is seen; the solution trusts them less (`with_less_trust`)."""


@dataclass(frozen=True)
class SnoopingRules:
    """When to remove and when to stop."""

    alpha: float
    """Probability that a good correspondence fails its test."""
    max_removed_share: float
    """No more than this share of the correspondences is removed; 0 tests without removing."""
    robust_variance: bool = False
    """Whether tests allow for a variance factor estimated robustly from all correspondences."""
    b_method_power: float | None = None
    """Test objects of every dimension with Baarda's B-method at this power; None: all at the level alpha."""

    def limit(self, degrees: float) -> float:
        """Give the limit of T with that many degrees of freedom (MATH 4.4); infinite for none."""
        if degrees < 1.0:
            return np.inf
        if self.b_method_power is None:
            return float(special.chdtri(degrees, self.alpha))
        return b_method_limit(round(degrees), self.alpha, self.b_method_power).critical


def adjust_and_snoop(
    problem: AnyProblem,
    start: Unknowns,
    rules: SnoopingRules,
    adjust: Adjust[AnyProblem],
    suspicious: Flags | None = None,
) -> SnoopingResult:
    """Adjust, remove the worst object while one fails, re-test what is out and put back the good (MATH 4.5).

    Objects go one at a time, all others re-tested beside those that are out: by the cheap step of MATH 4.5 until none
    fails, then by an adjustment, linearised at the better pose, that tests all of it again. An object is a
    correspondence, or a plane with all that depends on it (`gross_errors`). Where the mount of a photo is the worst,
    nothing is removed: its lines still know where they are to each other, so the mount is trusted less.

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
    trusted = np.ones(len(problem), dtype=bool) if suspicious is None else ~suspicious
    factor = robust_variance_factor(result.tests.selected(trusted), result.solution.redundancy)
    return result if factor == 1.0 else _snooped(problem, result.solution.unknowns, rules, adjust, factor, suspicious)


def adjusted(problem: AnyProblem, start: Unknowns, adjust: Adjust[AnyProblem], *, rough: bool = False) -> Solution:
    """Linearise observations and adjust them (MATH 3.1)."""
    return adjust(problem, start, problem.linearised(start), rough)


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
    fewest = max(int(used.sum()) - int(rules.max_removed_share * used.sum()), FEWEST_BLOCKS)
    steps: list[SnoopingStep] = []
    mounts: list[MountError] = []
    every, decisions = _Linearised(problem, start), 0
    while True:
        part, of_part = (problem, every.system) if used.all() else (problem.selected(used), every.system.selected(used))
        solution = adjust(part, every.values, of_part, True)
        every.follow(solution)
        search = GrossErrorSearch(solution, factor)
        found = search.tests()
        wrong = _wrong_mounts(problem, search, found, rules, mounts)
        if wrong:
            mounts.extend(wrong)
            problem = with_less_trust(problem, wrong)
            every = _Linearised(problem, solution.unknowns)
            continue
        removed = _wrong(search, found, np.flatnonzero(used), reinstated, rules, int(used.sum()) - fewest, mounts)
        if removed:
            steps.extend(replace(step, step=decisions + step.step) for step in removed)
            decisions = steps[-1].step
            used[[step.block for step in removed]] = False
            continue
        tests = _all_tests(every.system, used, solution).with_variance(factor)
        good = _good(tests, used, rules)
        if good:
            steps.extend(replace(step, step=decisions + step.step) for step in good)
            decisions = steps[-1].step
            used[[step.block for step in good]] = reinstated[[step.block for step in good]] = True
            continue
        solution = adjusted(part, solution.unknowns, adjust)
        every = _Linearised(problem, solution.unknowns)
        tests = _all_tests(every.system, used, solution).with_variance(factor)
        steps.extend(_never_used(decisions + 1, used, steps, tests, rules))
        return SnoopingResult(solution, used, reinstated, tests, factor, tuple(steps), tuple(mounts))


class _Linearised:
    """All correspondences, used or not, at the solution reached; small steps to the next are taken for linear."""

    def __init__(self, problem: Problem, values: Unknowns) -> None:
        self._problem = problem
        self.values = values
        self.system = problem.linearised(values)
        self._scales = values.scales(problem.extent_m())
        self._moved = np.zeros(values.count)

    def follow(self, solution: Solution) -> None:
        """Move on to a solution that was found from the values of before."""
        step = solution.linear_step
        if step is not None:
            self._moved += step
        if step is None or float(np.abs(self._moved / self._scales).max(initial=0.0)) >= LINEAR_STEP:
            self.system = self._problem.linearised(solution.unknowns)
            self._moved[:] = 0.0
        else:
            self.system = self.system.moved(step)
        self.values = solution.unknowns


def _never_used(
    step: int, used: Flags, steps: list[SnoopingStep], tests: BlockTests, rules: SnoopingRules
) -> list[SnoopingStep]:
    """Give a step for each correspondence that was out from the start and did not come back."""
    named = {entry.block for entry in steps}
    return [
        SnoopingStep(
            step,
            Change.REMOVED,
            block,
            float(tests.statistics[block]),
            rules.limit(float(tests.degrees[block])),
            (),
        )
        for block in np.flatnonzero(~used).tolist()
        if block not in named
    ]


def robust_variance_factor(tests: BlockTests, redundancy: int) -> float:
    """Estimate the variance factor from the median of T over its expected median, blunders notwithstanding (MATH 4.8).

    Parameters
    ----------
    tests
        Of all correspondences in a pose that blunders do not bend; removed ones count too.
    redundancy
        Of the used correspondences. Lines that share planes are worth fewer independent values of T than they are
        many: redundancy over the mean degrees of freedom of one.

    Returns
    -------
    The factor; 1 where the median does not clearly contradict the a-priori variances (by two of its own standard
    deviations).
    """
    controlled = tests.degrees > 0
    if not controlled.any() or redundancy <= 0:
        return 1.0
    degrees = tests.degrees[controlled]
    factor = float(np.median(tests.statistics[controlled] / chi2_ppf(0.5, degrees)))
    independent = min(redundancy / float(degrees.mean()), float(controlled.sum()))
    return factor if factor > 1.0 + 2.0 * MEDIAN_SPREAD / np.sqrt(independent) else 1.0


def _all_tests(system: LinearSystem, used: Flags, solution: Solution) -> BlockTests:
    """Put the tests of used and the predictions of unused correspondences into one."""
    inside = block_tests(solution)
    if used.all():
        return inside
    outside = predicted_block_tests(system, used, solution)
    merged = [np.array(values) for values in (outside.statistics, outside.degrees, outside.p_values)]
    for values, of_used in zip(merged, (inside.statistics, inside.degrees, inside.p_values), strict=True):
        values[used] = of_used
    return BlockTests(*merged)


def _wrong_mounts(
    problem: AnyProblem,
    search: GrossErrorSearch,
    tests: GrossErrorTests,
    rules: SnoopingRules,
    known: list[MountError],
) -> tuple[MountError, ...]:
    """Give the mounts that are the least probable of all hypotheses and fail their test.

    Those that are `known` several times already have been trusted less often enough.
    """
    k = _worst_mount(tests, rules, known) if rules.max_removed_share > 0.0 else None
    return () if k is None else mount_errors(problem, search, tests, k, rules.limit)


def _worst_mount(tests: GrossErrorTests, rules: SnoopingRules, known: list[MountError]) -> int | None:
    """Give the number of a mount that fails its test, less probable than all else that fails; None without one."""
    for k in np.argsort(tests.log_p, kind="stable").tolist():
        photo, critical = tests.photos[k], rules.limit(float(tests.degrees[k]))
        if photo is None:
            if tests.statistics[k] > critical:
                return None
            continue
        if tests.statistics[k] > critical and may_be_trusted_less(photo, known):
            return int(k)
    return None


def _good(tests: BlockTests, used: Flags, rules: SnoopingRules) -> list[SnoopingStep]:
    """Find what is out and agrees with what is used: all that fits well, or else the one that fits best."""
    out = np.flatnonzero(~used & (tests.degrees > 0))
    order = out[np.argsort(-tests.p_values[out], kind="stable")]
    steps: list[SnoopingStep] = []
    for block in order.tolist():
        critical = rules.limit(float(tests.degrees[block]))
        if tests.statistics[block] > critical or (steps and tests.p_values[block] < FITS_WELL):
            break
        statistic = float(tests.statistics[block])
        steps.append(SnoopingStep(len(steps) + 1, Change.REINSTATED, block, statistic, critical, ()))
    return steps


def _wrong(
    search: GrossErrorSearch,
    tests: GrossErrorTests,
    numbers: Array,
    reinstated: Flags,
    rules: SnoopingRules,
    allowance: int,
    known: list[MountError],
) -> list[SnoopingStep]:
    """Find the least probable hypothesis that fails its test, the next one beside it, and so on until none fails.

    Parameters
    ----------
    search, tests
        Of the used correspondences.
    numbers
        Their numbers among all.
    reinstated
        (number of blocks,) True for those that came back: they stay, so that the search ends.
    rules
        Level.
    allowance
        So many may still be removed.
    known
        Mounts that are trusted less already; where another one comes first, the next adjustment sees to it.

    Returns
    -------
    A step for each correspondence that is rejected, numbered from 1.
    """
    steps: list[SnoopingStep] = []
    stays = reinstated.copy()
    for number in count(1):
        k = _worst(tests, numbers, stays, rules, allowance - len(steps))
        if k is None or (steps and _worst_mount(tests, rules, known) is not None):
            break
        members = numbers[tests.blocks[k]]
        partners = tuple(replace(partner, block=int(numbers[partner.block])) for partner in search.inseparable(k))
        statistic, critical = float(tests.statistics[k]), rules.limit(float(tests.degrees[k]))
        steps += [
            SnoopingStep(number, Change.REMOVED, int(block), statistic, critical, partners, tests.planes[k])
            for block in members
        ]
        stays[members] = True  # nothing is removed twice; what else depends on them is asked about after an adjustment
        search.take_out(k)
        tests = search.tests()
    return steps


def _worst(tests: GrossErrorTests, numbers: Array, stays: Flags, rules: SnoopingRules, allowance: int) -> int | None:
    """Give the number of the least probable hypothesis that fails its test; None if there is none.

    Parameters
    ----------
    tests
        Of the used correspondences.
    numbers
        Their numbers among all.
    stays
        (number of blocks,) True for those that must not be removed.
    rules
        Level.
    allowance
        So many may still be removed.
    """
    for k in np.argsort(tests.log_p, kind="stable").tolist():
        members = numbers[tests.blocks[k]]
        if tests.photos[k] is not None or len(members) > allowance or stays[members].any():
            continue
        if tests.statistics[k] > rules.limit(float(tests.degrees[k])):
            return int(k)
    return None
