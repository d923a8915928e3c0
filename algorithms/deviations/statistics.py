"""What many deviations say together: mean, spread, quantiles, the largest, and their histogram."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Scalars
from algorithms.errors import InvalidInputError

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
NORMAL_MAD = 1.4826022185056018
"""Standard deviation of a normal distribution over its median absolute deviation."""


@dataclass(frozen=True)
class DeviationStatistics:
    """Figures of n signed deviations [m]."""

    count: int
    mean_m: float
    std_m: float
    """About the mean (n - 1); 0 for a single one."""
    rms_m: float
    """About zero."""
    mean_absolute_m: float
    quantiles_m: tuple[float, ...]
    """Of `QUANTILES`."""
    robust_std_m: float
    """1.4826 times the median of the absolute distances from the median: what single gross deviations do not change."""
    largest_m: float
    """The one of largest amount, with its sign."""
    largest_at: int
    """Which one that is."""
    share_within: float
    """Share of deviations within plus and minus the tolerance."""


def deviation_statistics(deviations_m: Scalars, tolerance_m: float) -> DeviationStatistics:
    """Summarise deviations, those that are NaN left out; O(n log n).

    Parameters
    ----------
    deviations_m
        (n,) signed [m].
    tolerance_m
        For the share within it [m].

    Raises
    ------
    InvalidInputError
        Where no deviation is finite.
    """
    places = np.flatnonzero(np.isfinite(deviations_m))
    if len(places) == 0:
        raise InvalidInputError("deviations", "no point has one")
    values = deviations_m[places]
    median = float(np.median(values))
    largest = int(np.argmax(np.abs(values)))
    return DeviationStatistics(
        count=len(values),
        mean_m=float(values.mean()),
        std_m=float(values.std(ddof=1)) if len(values) > 1 else 0.0,
        rms_m=float(np.sqrt(np.mean(values**2))),
        mean_absolute_m=float(np.abs(values).mean()),
        quantiles_m=tuple(np.quantile(values, QUANTILES).tolist()),
        robust_std_m=NORMAL_MAD * float(np.median(np.abs(values - median))),
        largest_m=float(values[largest]),
        largest_at=int(places[largest]),
        share_within=float(np.mean(np.abs(values) <= tolerance_m)),
    )


@dataclass(frozen=True, eq=False)
class Histogram:
    """Counts of deviations in classes of equal width."""

    edges_m: Float64[Array, "classes_and_1"]
    """(c + 1,) borders of the classes [m]."""
    counts: Int64[Array, "classes"]
    """(c,) deviations in each; those on a border belong to the class above."""
    below: int
    """Deviations below the first border."""
    above: int
    """Deviations above the last border."""


def histogram_of(deviations_m: Scalars, limit_m: float, classes: int) -> Histogram:
    """Count deviations between minus and plus a limit; NaN are left out.

    Parameters
    ----------
    deviations_m
        (n,) signed [m].
    limit_m
        Outermost borders [m].
    classes
        How many.
    """
    values = deviations_m[np.isfinite(deviations_m)]
    edges = np.linspace(-limit_m, limit_m, classes + 1)
    counts = np.histogram(values, edges)[0].astype(np.int64)
    return Histogram(edges, counts, int((values < -limit_m).sum()), int((values > limit_m).sum()))
