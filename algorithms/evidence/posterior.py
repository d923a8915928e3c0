"""How probable each of the poses is that were found, beside repetitions of the building and none of them at all."""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from algorithms.arrays import Array, Scalars
from algorithms.evidence.log_odds import LogOdds, Weights

LEAST_LIKENESS = 0.01
"""A scan that lies on itself with less of its surface is not like itself."""
CONTRADICTED_LIKENESS = 18.0
"""A scan is the less like itself the more of what can be judged stands in its own free space: this times the share."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Probabilities that sum to one."""

    best: int
    """Number of the most probable pose."""
    poses: Scalars
    """(h,) of each pose."""
    elsewhere: float
    """Of another place that looks like this one and that neither scan shows."""
    none: float
    """Of none of these: the scans have nothing in common, or the right pose was not found."""


def posterior(evidence: LogOdds, likeness: Scalars, weights: Weights) -> Posterior:
    """Give the probabilities of h poses.

    In a building that looks like itself the wrong pose really fits. What decides then is whether a second pose is more
    than chance, not how it compares with the best: it is as probable as its odds say, or as probable as it is that the
    building repeats itself under the motion between both, whichever is more. A repetition explains why a wrong pose
    fits, but not why surface stands in free space there: what is impossible in the second pose and not in the best
    tells them apart all the same.

    Parameters
    ----------
    evidence
        Of the h poses against chance.
    likeness
        (h,) how much the scans are like themselves under the motion from the best pose to each (`likeness_of`).
    weights
        Calibrated constants.
    """
    total = evidence.total
    best = int(np.argmax(total))
    odds = odds_beside(total, evidence.impossible, total[best], evidence.impossible[best], likeness, weights)
    odds[best] = 1.0
    none, elsewhere = float(np.exp(np.clip(-total[best], -700.0, 700.0))), float(np.exp(weights.elsewhere))
    whole = odds.sum() + none + elsewhere
    return Posterior(best, odds / whole, elsewhere / whole, none / whole)


def odds_beside(
    total: Scalars,
    impossible: Scalars,
    best: Scalars | float,
    best_impossible: Scalars | float,
    likeness: Scalars,
    weights: Weights,
) -> Scalars:
    """Give the odds of h poses against the best of their pair.

    Parameters
    ----------
    total, impossible
        (h,) log-odds against chance, and of them those by surface that cannot be there.
    best, best_impossible
        The same of the best pose of the pair that each belongs to.
    likeness, weights
        As of `posterior`.
    """
    repeats = expit(weights.repetition + weights.likeness * likeness) * expit(total)
    told_apart = np.exp(weights.told_apart * np.minimum(impossible - best_impossible, 0.0))
    return np.asarray(np.maximum(np.exp(total - best), repeats * told_apart))


def likeness_of(self_support: Array, self_violation: Array) -> Scalars:
    """Say how much two scans are like themselves under motions, from 0, not at all, upwards.

    Parameters
    ----------
    self_support, self_violation
        (h, 2) of each scan laid on itself: shares that fit, and that stand in its own free space.
    """
    contradicted = self_violation / np.maximum(self_support + self_violation, 1e-9)
    alike = self_support * np.exp(-CONTRADICTED_LIKENESS * contradicted)
    return np.asarray(np.log(np.maximum(alike.max(axis=1), LEAST_LIKENESS) / LEAST_LIKENESS))
