"""Standard deviations and tests keep their promises over many noisy scenes (fast form of the Monte Carlo, MATH 10).

Each figure may leave the band that its own sampling distribution gives for this number of runs with 99.9 %. The
long form, with the narrow limits of MATH 8, runs on request: tests/benchmark/test_monte_carlo.py.
"""

from functools import cache

import numpy as np
import pytest
from scipy import stats

from tests.measures.monte_carlo import NAMES, MonteCarlo, run_monte_carlo, scene_pairs

pytestmark = pytest.mark.slow

RUNS = 40
TAIL = 0.0005
"""Each side of a band that holds 99.9 %."""
PLANTS = {"generic 8": 2}
"""Errors of the detectable size planted in each scene: of one kind only, for speed."""

each_kind = pytest.mark.parametrize("name", NAMES)


@cache
def monte_carlo(name: str) -> MonteCarlo:
    return run_monte_carlo(scene_pairs(name), RUNS, np.random.default_rng(31), plants=PLANTS.get(name, 0))


def chi_square_band(degrees: float) -> tuple[float, float]:
    """Band of chi-square over its degrees of freedom."""
    low, high = stats.chi2.ppf([TAIL, 1.0 - TAIL], degrees) / degrees
    return float(low), float(high)


@each_kind
def test_normalised_squared_error_of_the_pose_is_chi_square(name: str) -> None:
    low, high = chi_square_band(6 * RUNS)
    assert low < monte_carlo(name).mean_nees / 6.0 < high


@each_kind
def test_ellipsoids_cover_the_truth_as_often_as_they_promise(name: str) -> None:
    low, high = stats.binom.ppf([TAIL, 1.0 - TAIL], RUNS, 0.95) / RUNS
    assert low <= monte_carlo(name).ellipsoid_coverage <= high


@each_kind
def test_standard_deviation_of_each_parameter_is_that_of_its_errors(name: str) -> None:
    # six at once: a sixth of the tail for each
    low, high = stats.chi2.ppf([TAIL / 6.0, 1.0 - TAIL / 6.0], RUNS) / RUNS
    ratios = monte_carlo(name).reported_over_true
    assert (ratios > 1.0 / np.sqrt(high)).all()
    assert (ratios < 1.0 / np.sqrt(low)).all()


@each_kind
def test_omega_is_as_large_as_the_redundancy(name: str) -> None:
    result = monte_carlo(name)
    low, high = chi_square_band(float(result.redundancies.sum()))
    assert low < result.omega_over_redundancy < high


def test_single_tests_reject_one_good_component_in_a_thousand() -> None:
    results = [monte_carlo(name) for name in NAMES]
    tested = sum(result.w_tested.sum() for result in results)
    share = sum(result.w_rejected.sum() for result in results) / tested
    # components of one adjustment are correlated: standard deviations from the scatter between runs
    variance = sum((result.type_one_std * result.w_tested.sum() / tested) ** 2 for result in results)
    assert abs(share - 0.001) < stats.norm.isf(TAIL) * np.sqrt(variance)


def test_line_tests_reject_one_good_line_in_a_thousand() -> None:
    results = [monte_carlo(name) for name in NAMES]
    tested = int(sum(result.lines_tested.sum() for result in results))
    low, high = stats.binom.ppf([TAIL, 1.0 - TAIL], tested, 0.001)
    assert low <= sum(result.lines_rejected.sum() for result in results) <= high


def test_errors_of_the_detectable_size_are_found_in_eighty_of_a_hundred() -> None:
    found = np.concatenate([monte_carlo(name).planted_found.ravel() for name in PLANTS])
    low, high = stats.binom.ppf([TAIL, 1.0 - TAIL], len(found), 0.8) / len(found)
    assert low <= found.mean() <= high
