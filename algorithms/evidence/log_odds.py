"""The log-odds of a pose against chance: terms that add up, the same for every pair, each read off two scans.

How much of a right pose stands in free space differs from pair to pair far more than chance would have it: next to
nothing in a building that is left alone, a tenth where furniture moved. Counts that scatter like that have heavy tails,
and what they say grows with their logarithms: the first square metre in free space says most, the hundredth hardly
anything. So do pieces that fit. What a pair shows of *any* pose that is proposed is the chance level of this very pair:
a pose is more than chance by what it is ahead of the next, and less where nearly all poses look as good.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Scalars
from algorithms.evidence.pose_evidence import PoseEvidence

FULL_PATCHES = 20.0
"""Patches of a piece that fit at which two thirds of what a piece can say is said."""
LEAST_AGAINST, LEAST_FITTING = 0.1, 20.0
"""Patches added to those against a pose and to those that fit, so that none of either is no infinite odds."""
MOST_AHEAD = 9.0
"""No pose is ahead of the next by more than this, nor one that stands alone: the right one may not have been found."""


@dataclass(frozen=True)
class Weights:
    """The calibrated constants (`calibration.json`)."""

    through: float
    """Of the logarithm of patches that fit to patches that were looked through."""
    beside: float
    """Of the logarithm of patches that fit to patches beside parallel surface."""
    fitting: float
    """Of the logarithm of the number of pieces that fit."""
    against: float
    """Of the logarithm of the number of pieces that cannot be where they are."""
    determined: float
    """Of how well the patches that fit determine the pose, beside what so many could."""
    ahead: float
    """Of the distance from the next pose, `MOST_AHEAD` at most."""
    usual: float
    """Of what free space and parallel surface say of the middle one of all poses of the pair."""
    chosen: float
    """Taken off each pose: what being chosen gives it."""
    elsewhere: float
    """Log-odds that another place, which neither scan shows, looks like this one; no pair can tell."""


@dataclass(frozen=True, eq=False)
class Counts:
    """The evidence of h poses side by side."""

    fits: Float64[Array, "h"]
    """(h,) patches that fit."""
    through: Float64[Array, "h"]
    """(h,) patches that were looked through."""
    beside: Float64[Array, "h"]
    """(h,) patches beside parallel surface."""
    fitting: Float64[Array, "h"]
    """(h,) pieces that fit, the more of each the more of its patches do (`FULL_PATCHES`)."""
    against: Float64[Array, "h"]
    """(h,) pieces that cannot be where they are."""
    control: Float64[Array, "h"]
    """(h,) `PoseEvidence.control`."""
    pair: Int64[Array, "h"]
    """(h,) number of the pair that each belongs to, ascending from zero without gaps."""

    @classmethod
    def of(cls, poses: Sequence[PoseEvidence]) -> "Counts":
        """Put the evidence of the poses of one pair side by side."""
        return cls(
            np.array([each.fitting.sum() for each in poses]),
            np.array([each.through.sum() for each in poses]),
            np.array([each.beside.sum() for each in poses]),
            np.array([pieces_of(each.fitting).sum() for each in poses]),
            np.array([float(len(each.through)) for each in poses]),
            np.array([each.control for each in poses]),
            np.zeros(len(poses), dtype=np.int64),
        )


def pieces_of(fitting: Scalars) -> Scalars:
    """Give what pieces count, of which so many patches fit: each from nothing to one."""
    return np.asarray(-np.expm1(-fitting / FULL_PATCHES))


@dataclass(frozen=True, eq=False)
class LogOdds:
    """What each source says of h poses; their sum is the log-odds against chance."""

    free_space: Scalars
    """(h,) patches that fit beside those that were looked through."""
    beside: Scalars
    """(h,) patches that fit beside those beside parallel surface."""
    pieces: Scalars
    """(h,) pieces that fit, and pieces that cannot be where they are."""
    determined: Scalars
    """(h,) how well the pose is determined."""
    ahead: Scalars
    """(h,) how far it is ahead of the next pose; negative of all but the best."""
    usual: Scalars
    """(h,) what is usual for poses of this pair, taken off."""
    chosen: Scalars
    """(h,) for having been chosen; negative."""

    @property
    def total(self) -> Scalars:
        """(h,) sum."""
        own = self.free_space + self.beside + self.pieces + self.determined
        return np.asarray(own + self.ahead + self.usual + self.chosen)


def log_odds(counts: Counts, weights: Weights) -> LogOdds:
    """Weigh the evidence of h poses, of one pair or of many. O(h log h)."""
    fits = np.log(counts.fits + LEAST_FITTING)
    free_space = weights.through * (fits - np.log(counts.through + LEAST_AGAINST))
    beside = weights.beside * (fits - np.log(counts.beside + LEAST_AGAINST))
    pieces = weights.fitting * np.log1p(counts.fitting) - weights.against * np.log1p(counts.against)
    # of n patches the determinant of six parameters grows with the sixth power
    determined = weights.determined * (counts.control - 6.0 * np.log1p(counts.fits / 2.0))
    first, size = np.unique(counts.pair, return_index=True, return_counts=True)[1:]
    usual = _middle(free_space + beside, counts.pair, first, size)
    ahead = _ahead(free_space + beside + pieces + determined, counts.pair, first, size)
    return LogOdds(
        free_space,
        beside,
        pieces,
        determined,
        weights.ahead * ahead,
        -weights.usual * usual[counts.pair],
        np.full(len(fits), -weights.chosen),
    )


def _ahead(own: Scalars, pair: Array, first: Array, size: Array) -> Scalars:
    """Give how far each pose is ahead of the best other one of its pair."""
    order = np.lexsort((-own, pair))
    best, second = order[first], order[first + np.minimum(size, 2) - 1]
    ahead = own - own[best][pair]
    ahead[best] = np.where(size > 1, np.minimum(own[best] - own[second], MOST_AHEAD), MOST_AHEAD)
    return np.asarray(ahead)


def _middle(values: Scalars, pair: Array, first: Array, size: Array) -> Array:
    """Give the median of the values of each pair."""
    order = np.lexsort((values, pair))
    return np.asarray((values[order[first + (size - 1) // 2]] + values[order[first + size // 2]]) / 2.0)


def of_impossible(through: Scalars, beside: Scalars, pose: PoseEvidence, weights: Weights) -> Scalars:
    """Give what each of the pieces that cannot be where they are takes off the log-odds: as if it alone were missing.

    Parameters
    ----------
    through, beside
        (b,) patches of each piece.
    pose
        The evidence of the pose, with all its pieces.
    weights
        Calibrated constants.
    """
    said = np.zeros(len(through))
    for weight, all_of_it, own in (
        (weights.through, pose.through.sum(), through),
        (weights.beside, pose.beside.sum(), beside),
    ):
        rest = np.maximum(all_of_it - own, 0.0)
        said -= weight * np.log((all_of_it + LEAST_AGAINST) / (rest + LEAST_AGAINST))
    count = len(pose.through)
    return np.asarray(said - weights.against * np.log((count + 1.0) / max(count, 1)))
