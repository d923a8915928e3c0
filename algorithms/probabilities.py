"""Tails and quantiles of the distributions that tests of hypotheses use.

They are those of `scipy.special`. `scipy.stats` gives the same figures, but loads hundreds of distributions: half a
second and 40 MB of each process, and takes ten times as long a call.
"""

from math import comb
from typing import Any

import numpy as np
from scipy import special

Numbers = Any
"""A number or an array of them."""


def chi2_sf(statistic: Numbers, degrees: Numbers) -> Numbers:
    """Give the probability that χ² of so many degrees of freedom exceeds a statistic; nan for no degrees."""
    return special.chdtrc(_positive(degrees), statistic)


def chi2_isf(probability: Numbers, degrees: Numbers) -> Numbers:
    """Give what χ² exceeds with a probability; nan for no degrees of freedom."""
    return special.chdtri(_positive(degrees), probability)


def chi2_ppf(probability: Numbers, degrees: Numbers) -> Numbers:
    """Give what χ² stays below with a probability; nan for no degrees of freedom."""
    return 2.0 * special.gammaincinv(0.5 * _positive(degrees), probability)


def ncx2_sf(statistic: Numbers, degrees: Numbers, noncentrality: Numbers) -> Numbers:
    """Give the probability that the non-central χ'² exceeds a statistic; exact to 1e-16, not relative to itself."""
    return 1.0 - special.chndtr(statistic, degrees, noncentrality)


def ncx2_isf(probability: Numbers, degrees: Numbers, noncentrality: Numbers) -> Numbers:
    """Give what the non-central χ'² exceeds with a probability."""
    return special.chndtrix(1.0 - np.asarray(probability), degrees, noncentrality)


def norm_cdf(value: Numbers) -> Numbers:
    """Give the probability that a standard normal variable stays below a value."""
    return special.ndtr(value)


def norm_sf(value: Numbers) -> Numbers:
    """Give the probability that a standard normal variable exceeds a value."""
    return special.ndtr(-np.asarray(value))


def norm_ppf(probability: Numbers) -> Numbers:
    """Give what a standard normal variable stays below with a probability."""
    return special.ndtri(probability)


def norm_isf(probability: Numbers) -> Numbers:
    """Give what a standard normal variable exceeds with a probability."""
    return -special.ndtri(probability)


def t_isf(probability: Numbers, degrees: Numbers) -> Numbers:
    """Give what Student's t exceeds with a probability."""
    return -special.stdtrit(degrees, probability)


def f_sf(statistic: Numbers, degrees: Numbers, other_degrees: Numbers) -> Numbers:
    """Give the probability that Fisher's F exceeds a statistic."""
    return special.fdtrc(degrees, other_degrees, statistic)


def log_erlang_sf(total: float, count: int) -> float:
    """Give the logarithm of the probability that so many exponential variables of mean 1 add up to more than a total.

    It is exact where the probability itself is too small for a number. O(count).
    """
    if count == 0:
        return 0.0
    terms = np.arange(count)
    return float(special.logsumexp(special.xlogy(terms, total) - special.gammaln(terms + 1.0)) - total)


def fisher_exact_greater(found: int, of: int, other_found: int, of_other: int) -> float:
    """Give the probability that chance alone puts so many of all found ones, or more, into the first of two groups.

    Fisher's exact test, one-sided: whether `found` out of `of` is a greater rate than `other_found` out of `of_other`.
    """
    finds = found + other_found
    ways = sum(comb(of, k) * comb(of_other, finds - k) for k in range(found, min(of, finds) + 1))
    return ways / comb(of + of_other, finds)


def _positive(degrees: Numbers) -> Numbers:
    """Replace what are no degrees of freedom by nan: a test of nothing has no outcome."""
    degrees = np.asarray(degrees, dtype=np.float64)
    return np.where(degrees > 0.0, degrees, np.nan)
