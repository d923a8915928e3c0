"""Noise of the ranges of a structured scan, from ranges alone."""

import numpy as np

from algorithms.arrays import Array
from algorithms.scans.range_noise_kernels import contradictions

FEW_TRIPLETS = 100
"""Fewer usable triplets of neighbours tell nothing."""
MOST_TRIPLETS = 100_000
"""Columns are thinned to about so many triplets: a median needs no more."""
FLATTEST_STEP = 0.2
"""Neighbours whose ranges differ by a larger share of themselves lie on different things."""
NORMAL_QUARTILE = 0.3186394
"""Lower quartile of |x| for a standard normal x."""


def range_noise(ranges: Array) -> float:
    """Estimate the standard deviation of single ranges [m]; 0 where too few neighbours came back to tell.

    On a plane the reciprocal range along a vertical circle is a sinusoid of the angle: of three neighbours at distances
    of one step the middle one is the mean of the outer ones but for the cosine of the step, which is negligible. So its
    contradiction is noise, whatever the inclination and distance of the plane. Its lower quartile is taken, because
    edges, mixed pixels and rough surfaces only add to it.

    Parameters
    ----------
    ranges
        (rows, columns) ranges along vertical circles, 0 where nothing came back [m].
    """
    step = max(1, ranges.size // MOST_TRIPLETS)
    contradiction = contradictions(np.ascontiguousarray(ranges[:, ::step]), FLATTEST_STEP)
    if len(contradiction) < FEW_TRIPLETS:
        return 0.0
    # errors of the outer reciprocals, seen at the middle range, count a quarter each: 1 + 1/4 + 1/4
    return float(np.quantile(contradiction, 0.25) / np.sqrt(1.5)) / NORMAL_QUARTILE
