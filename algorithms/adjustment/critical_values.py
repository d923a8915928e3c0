"""Critical values of tests of different dimension that find the same error alike: Baarda's B-method (MATH 4.4)."""

from dataclasses import dataclass
from functools import lru_cache

from algorithms.adjustment.testing import noncentrality
from algorithms.probabilities import chi2_sf, ncx2_isf


@dataclass(frozen=True)
class BMethodLimit:
    """Limit of a test statistic that belongs to the same non-centrality and power in every dimension."""

    degrees_of_freedom: int
    critical: float
    """Limit of T."""
    alpha: float
    """Probability that a good observation exceeds it; grows with the dimension."""


@lru_cache(maxsize=64)
def b_method_limit(degrees_of_freedom: int, alpha: float, power: float) -> BMethodLimit:
    """Find the limit k with P(χ'²(d, λ0) > k) = power, λ0 = δ0² that of the one-dimensional test (MATH 4.4).

    Baarda, A testing procedure for use in geodetic networks (1968), B-method: an error that just shows with the given
    power in the test of its own component shows with the same power in the test of the whole line or plane. For 0.1 %
    and 80 %: 13.54 in four dimensions, where a good line exceeds it in 0.89 % of the cases.

    Parameters
    ----------
    degrees_of_freedom
        Dimension of the test, from 1.
    alpha
        Level of the one-dimensional test.
    power
        Probability with which the error is found.
    """
    shift = noncentrality(alpha, power) ** 2
    critical = float(ncx2_isf(power, degrees_of_freedom, shift))
    return BMethodLimit(degrees_of_freedom, critical, float(chi2_sf(critical, degrees_of_freedom)))
