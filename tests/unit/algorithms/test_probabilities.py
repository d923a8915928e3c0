"""Tails and quantiles beside those of scipy.stats."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from algorithms import probabilities
from algorithms.probabilities import chi2_isf, chi2_ppf, chi2_sf, fisher_exact_greater, log_erlang_sf, ncx2_sf

DEGREES = np.array([1, 2, 3, 6, 40, 2000])
PROBABILITIES = np.array([1e-9, 0.001, 0.05, 0.5, 0.8, 0.999])[:, None]


@pytest.mark.parametrize("name", ["chi2_isf", "chi2_ppf", "t_isf", "norm_isf", "norm_ppf"])
def test_a_quantile_is_that_of_the_reference(name: str) -> None:
    family, tail = name.split("_")
    further = () if family == "norm" else (DEGREES,)
    own: Callable[..., Any] = getattr(probabilities, name)
    expected = getattr(getattr(stats, family), tail)(PROBABILITIES, *further)
    np.testing.assert_allclose(own(PROBABILITIES, *further), expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["chi2_sf", "norm_sf", "norm_cdf", "f_sf"])
def test_a_tail_is_that_of_the_reference(name: str) -> None:
    family, tail = name.split("_")
    further = {"norm": (), "chi2": (DEGREES,), "f": (DEGREES, 7)}[family]
    values = np.array([0.0, 0.01, 1.0, 12.0, 60.0])[:, None]
    own: Callable[..., Any] = getattr(probabilities, name)
    expected = getattr(getattr(stats, family), tail)(values, *further)
    np.testing.assert_allclose(own(values, *further), expected, rtol=1e-11)


@pytest.mark.parametrize("noncentrality", [0.5, 17.07, 150.0])
def test_non_central_quantiles_are_those_of_the_reference(noncentrality: float) -> None:
    degrees = np.array([1, 2, 4, 6])
    found = probabilities.ncx2_isf(0.8, degrees, noncentrality)
    np.testing.assert_allclose(found, stats.ncx2.isf(0.8, degrees, noncentrality), rtol=1e-10)
    np.testing.assert_allclose(ncx2_sf(found, degrees, noncentrality), 0.8, rtol=1e-10)


def test_a_test_of_nothing_has_no_outcome() -> None:
    assert np.isnan([chi2_sf(3.0, 0), chi2_isf(0.05, 0), chi2_ppf(0.95, 0)]).all()


@pytest.mark.parametrize("counts", [(9, 10, 1, 10), (3, 30, 3, 25), (0, 5, 4, 6), (200, 300, 90, 250)])
def test_fishers_exact_test_is_that_of_the_reference(counts: tuple[int, int, int, int]) -> None:
    found, of, other_found, of_other = counts
    table = [[found, of - found], [other_found, of_other - other_found]]
    expected = stats.fisher_exact(table, alternative="greater").pvalue
    np.testing.assert_allclose(fisher_exact_greater(*counts), expected, rtol=1e-9)


@pytest.mark.parametrize(("total", "count"), [(0.0, 3), (2.0, 1), (30.0, 12), (400.0, 50)])
def test_sums_of_powers_are_as_likely_as_gamma_says(total: float, count: int) -> None:
    np.testing.assert_allclose(log_erlang_sf(total, count), stats.gamma.logsf(total, count), rtol=1e-9, atol=1e-12)


def test_the_less_likely_of_two_sums_is_told_where_both_probabilities_vanish() -> None:
    assert log_erlang_sf(9000.0, 30) < log_erlang_sf(1000.0, 30) < -700.0
