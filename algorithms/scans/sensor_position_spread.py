"""How well a cloud tells where its instrument stood: how far away other positions explain it nearly as well."""

from collections.abc import Callable
from itertools import product

import numpy as np

from algorithms.arrays import Array

RADII_M = 0.08 * 1.6 ** np.arange(11)
"""Distances from the found position at which others are tried [m], up to 9 m."""
DIRECTIONS = np.vstack([np.eye(3), -np.eye(3), np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(3.0)])
"""Directions in which they are tried."""
LEAST_DIFFERENCE, RELATIVE_DIFFERENCE = 0.0006, 0.1
"""Costs that differ by so little, and by this share of the smallest, say nothing: so much better than the true position
did found ones explain clouds."""
LEAST_STD_M = 0.05
"""Steps of the search are no smaller."""


def position_std(costs_near: Callable[[Array], Array], minima_m: Array, minima_costs: Array) -> float:
    """Give the standard deviation of a found position, all directions together [m].

    Every position x that may be meant has the weight exp(-((c(x) - c) / d)^2 / 2), with c the cost of the found one and
    d what costs tell of each other. The weights are integrated over shells around the found position, and other minima
    of the search count as much as it does itself, weighed in the same way. A flat minimum, or a second one elsewhere,
    makes the position uncertain; both are what happens where hardly anything hides anything.

    Parameters
    ----------
    costs_near
        Gives the costs of (m, 3) positions; infinite where no instrument can stand.
    minima_m, minima_costs
        (k, 3) where the search came down [m], and (k,) the costs there; the first is the found position.
    """
    found_m, least_cost = minima_m[0], float(minima_costs[0])
    difference = LEAST_DIFFERENCE + RELATIVE_DIFFERENCE * least_cost
    around = found_m + RADII_M[:, None, None] * DIRECTIONS
    excess = costs_near(around.reshape(-1, 3)).reshape(len(RADII_M), -1) - least_cost
    likely = np.exp(-0.5 * (np.maximum(excess, 0.0) / difference) ** 2).mean(axis=1)
    shells = likely * RADII_M**3  # equal steps of the logarithm of the radius: r^2 dr is r^3 d(log r)
    shells[0] += RADII_M[0] ** 3  # the ball within
    variance = float(np.sum(shells * RADII_M**2) / np.sum(shells))
    weights = np.exp(-0.5 * (np.maximum(minima_costs - least_cost, 0.0) / difference) ** 2)
    apart = np.sum((minima_m - found_m) ** 2, axis=1)
    return float(max(np.sqrt(variance + weights @ apart / weights.sum()), LEAST_STD_M))
