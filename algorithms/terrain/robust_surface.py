"""Surfaces by linear prediction with weights that fall on one side (Kraus and Pfeifer 1998)."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Points, Scalars
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.linear_prediction import Covariance, predicted

ROUNDS = 6
SETTLED = 0.01
"""Mean change of the weights below which the iteration ends."""
EXPONENT = 4.0
"""Of the weight function, with slant and half width alike."""


@dataclass(frozen=True)
class WeightFunction:
    """1 below an origin, then falling, 0 beyond a cut."""

    half_width_m: float
    """Height above the origin at which a weight is halved [m]."""
    cut_m: float
    """Height above the origin beyond which it is 0 [m]."""

    def weights(self, residuals_m: Scalars, origin_m: float) -> Scalars:
        """Give the weights (n,) of points by their heights above the surface [m]."""
        above = np.maximum(residuals_m - origin_m, 0.0)
        bell = 1.0 / (1.0 + (above / self.half_width_m) ** EXPONENT)
        return np.where(above > self.cut_m, 0.0, bell)


def robust_weights(
    points: Points,
    covariance: Covariance,
    function: WeightFunction,
    progress: Progress,
    start: Scalars | None = None,
) -> tuple[Scalars, Scalars]:
    """Repeat linear prediction with asymmetric weights until they hardly change.

    Parameters
    ----------
    points
        (n, 3) [m].
    covariance
        Of the terrain.
    function
        Of the weights.
    progress
        Of the rounds.
    start
        (n,) weights of the first round; None: all are 1. Points of weight 0 may come back.

    Returns
    -------
    Weights (n,), and residuals (n,) of the points above the last surface [m].
    """
    weights = np.ones(len(points)) if start is None else start
    residuals = np.zeros(len(points))
    for turn in range(ROUNDS):
        part = ProgressSection(progress, turn / ROUNDS, (turn + 1) / ROUNDS)
        residuals = points[:, 2] - predicted(points, weights, points, covariance, part).heights_m
        renewed = function.weights(residuals, origin_of(residuals))
        change = float(np.abs(renewed - weights).mean())
        weights = renewed
        if change < SETTLED:
            break
    return weights, residuals


def origin_of(residuals_m: Scalars) -> float:
    """Estimate the origin g of the weight function: the median of the heights below the surface [m], at most 0.

    Ground and objects mixed, the surface lies between them, and what is below it is ground.
    """
    below = residuals_m[residuals_m < 0.0]
    return float(np.median(below)) if len(below) else 0.0
