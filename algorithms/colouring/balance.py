"""Differences of exposure, white balance and light fall-off between photos, from points that several of them show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Scalars

DARKEST, BRIGHTEST = 8.0, 245.0
"""Grey levels beyond these say nothing of the light: noise, burnt out."""
LEAST_COMMON = 30
"""Pairs of photos with fewer points in common tell nothing."""
ROUNDS = 5
FALL_OFF_STD = 0.3
"""Light fall-off is expected within about this, as a logarithm, in the corners."""
ROBUST = 1.345
"""Of Huber's weights, in robust standard deviations."""


@dataclass(frozen=True, eq=False)
class Balance:
    """What turns the grey levels of each photo into those of the mean of all."""

    log_gains: Float64[Array, "photos 3"]
    """Logarithm of how much brighter each photo is than the mean of all, by colour."""
    log_fall_off: Float64[Array, "3"]
    """Logarithm of the brightness in the corners over that in the middle, common to all photos."""
    std: Float64[Array, "3"]
    """Robust standard deviation of the differences that are left between two photos of a point, as logarithms."""
    pairs: int
    """Pairs of photos that took part."""

    def balanced(self, photo: int, colors: Float64[Array, "m 3"], radius: Scalars) -> Float64[Array, "m 3"]:
        """Take gain and fall-off out of colours."""
        return np.asarray(colors / np.exp(self.log_gains[photo] + radius[:, None] ** 2 * self.log_fall_off))


def no_balance(count: int) -> Balance:
    """Give the balance of so many photos that leaves them as they are."""
    return Balance(np.zeros((count, 3)), np.zeros(3), np.zeros(3), 0)


def balance_of(colors: Sequence[Float64[Array, "n 3"]], radii: Sequence[Scalars]) -> Balance:
    """Estimate gains and fall-off by robust least squares on logarithms: gamma changes their scale only.

    Parameters
    ----------
    colors
        For every photo the grey levels of the same points, NaN where it does not show them.
    radii
        For every photo the distance of these points from its principal point, 1 in the corner.

    Returns
    -------
    Photos without points in common with others keep their levels; so do groups of such, each as a whole.
    """
    count = len(colors)
    log_gains, fall_off, std = np.zeros((count, 3)), np.zeros(3), np.zeros(3)
    usable = [np.where((c > DARKEST) & (c < BRIGHTEST), c, np.nan) for c in colors]
    logs = [np.log(each) for each in usable]
    used: set[tuple[int, int]] = set()
    for channel in range(3):
        pairs = []
        for i in range(count):
            for j in range(i + 1, count):
                both = np.isfinite(logs[i][:, channel]) & np.isfinite(logs[j][:, channel])
                if int(both.sum()) >= LEAST_COMMON:
                    used.add((i, j))
                    difference = logs[i][both, channel] - logs[j][both, channel]
                    pairs.append((i, j, difference, radii[i][both] ** 2 - radii[j][both] ** 2))
        if pairs:
            log_gains[:, channel], fall_off[channel], std[channel] = _solved(count, pairs)
    return Balance(log_gains, fall_off, std, len(used))


def _solved(count: int, pairs: Sequence[tuple[int, int, Array, Array]]) -> tuple[Array, float, float]:
    """Solve for the gains (photos,) and the fall-off of one colour; the gains have the mean zero."""
    unknowns: Array = np.zeros(count + 1)
    scale = 1.0
    for _ in range(ROUNDS):
        normal, right = np.zeros((count + 1, count + 1)), np.zeros(count + 1)
        left: list[Array] = []
        for i, j, difference, radial in pairs:
            residual = difference - (unknowns[i] - unknowns[j]) - unknowns[count] * radial
            left.append(residual)
            weight = np.minimum(1.0, ROBUST * scale / np.maximum(np.abs(residual), 1e-12)) / scale**2
            total, mixed = float(weight.sum()), float((weight * radial).sum())
            for a, b, value in ((i, i, total), (j, j, total), (i, j, -total), (j, i, -total)):
                normal[a, b] += value
            for a, sign in ((i, 1.0), (j, -1.0)):
                normal[a, count] += sign * mixed
                normal[count, a] += sign * mixed
                right[a] += sign * float((weight * difference).sum())
            normal[count, count] += float((weight * radial**2).sum())
            right[count] += float((weight * radial * difference).sum())
        normal[count, count] += 1.0 / FALL_OFF_STD**2
        # the mean of the gains, and those of photos apart from the others, are free: the shortest answer is taken
        unknowns = np.linalg.lstsq(normal, right, rcond=1e-12)[0]
        residuals = np.concatenate(left)
        scale = max(1.4826 * float(np.median(np.abs(residuals))), 1e-6)
    return unknowns[:count] - unknowns[:count].mean(), float(unknowns[count]), scale
