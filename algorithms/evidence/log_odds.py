"""The log-odds of a pose against chance: terms that add up, each bounded by what one piece of surface can say.

A piece that stands in free space speaks against a pose, but it may have moved between the scans: however large it is,
it costs no more than the logarithm of how seldom that happens. A plane that lies on a plane speaks for a pose, but
planes lie on planes by chance: however large it is, it counts no more than the logarithm of how often they do. So
pieces add up, and patches within a piece saturate. What a pose was given by being chosen out of all poses is taken off
(`chosen`), so that the first few planes, which any pose can be made to fit, prove nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Scalars
from algorithms.evidence.pose_evidence import PoseEvidence


@dataclass(frozen=True)
class Weights:
    """The calibrated constants (`calibration.json`), all but the first four in units of log-odds."""

    fitting_patches: float
    """Patches of a piece that fit at which two thirds of what it can say is said."""
    against_patches: float
    """The same of patches of a piece that cannot be where it is."""
    beside: float
    """What a patch beside parallel surface counts, of one that was looked through."""
    likeness: float
    """How steeply the probability of a repetition grows with how much a scan is like itself."""
    fitting: float
    """Most that a piece that fits says for a pose."""
    against: float
    """Most that a piece that cannot be where it is says against it."""
    found: float
    """Of a line that the other scan should have seen and has."""
    missing: float
    """Of one that it has not."""
    features: float
    """Of the square root of the number of lines and planes that lie closely on each other."""
    control: float
    """Of a unit of `PoseEvidence.control`."""
    chosen: float
    """Taken off each pose: what being chosen gives it."""
    repetition: float
    """Log-odds that a building repeats itself under a motion under which neither scan is like itself."""
    told_apart: float
    """How much of what is impossible in a repetition of the best pose, and not in that, speaks against it."""
    elsewhere: float
    """Log-odds that another place, which neither scan shows, looks like this one."""


@dataclass(frozen=True, eq=False)
class Counts:
    """The evidence of h poses side by side; pieces of all poses one after the other."""

    fitting: Float64[Array, "a"]
    """(a,) patches that fit, by pieces."""
    fitting_pose: Int64[Array, "a"]
    """(a,) number of the pose that each of them belongs to."""
    through: Float64[Array, "b"]
    """(b,) patches that were looked through, by pieces that cannot be where they are."""
    beside: Float64[Array, "b"]
    """(b,) patches of these pieces beside parallel surface."""
    against_pose: Int64[Array, "b"]
    """(b,) number of the pose that each of them belongs to."""
    found: Float64[Array, "h"]
    """(h,) lines that are found again."""
    missing: Float64[Array, "h"]
    """(h,) lines that should have been seen and are not."""
    features: Float64[Array, "h"]
    """(h,) lines and planes in common."""
    control: Float64[Array, "h"]
    """(h,) `PoseEvidence.control`."""

    @classmethod
    def of(cls, poses: Sequence[PoseEvidence]) -> "Counts":
        """Put the evidence of poses side by side."""
        numbers = np.arange(len(poses))
        return cls(
            np.concatenate([np.zeros(0), *(each.fitting for each in poses)]),
            np.repeat(numbers, [len(each.fitting) for each in poses]),
            np.concatenate([np.zeros(0), *(each.through for each in poses)]),
            np.concatenate([np.zeros(0), *(each.beside for each in poses)]),
            np.repeat(numbers, [len(each.through) for each in poses]),
            np.array([each.lines.found for each in poses], dtype=np.float64),
            np.array([each.lines.expected - each.lines.found for each in poses], dtype=np.float64),
            np.array([each.common for each in poses], dtype=np.float64),
            np.array([each.control for each in poses]),
        )


@dataclass(frozen=True, eq=False)
class LogOdds:
    """What each source says of h poses; their sum is the log-odds against chance."""

    fits: Scalars
    """(h,) pieces that fit; never negative."""
    impossible: Scalars
    """(h,) pieces in free space or beside surface; never positive."""
    lines: Scalars
    """(h,) lines that should have been seen."""
    features: Scalars
    """(h,) lines and planes in common, and how well they determine the pose."""
    chosen: Scalars
    """(h,) for having been chosen; negative."""

    @property
    def total(self) -> Scalars:
        """(h,) sum."""
        return np.asarray(self.fits + self.impossible + self.lines + self.features + self.chosen)


def log_odds(counts: Counts, weights: Weights) -> LogOdds:
    """Weigh the evidence of h poses. O(pieces)."""
    h = len(counts.found)
    fitting = 1.0 - np.exp(-counts.fitting / weights.fitting_patches)
    return LogOdds(
        weights.fitting * _sums(counts.fitting_pose, fitting, h),
        _sums(counts.against_pose, of_impossible(counts.through, counts.beside, weights), h),
        weights.found * counts.found - weights.missing * counts.missing,
        weights.features * np.sqrt(counts.features) + weights.control * counts.control,
        np.full(h, -weights.chosen),
    )


def _sums(numbers: Int64[Array, "n"], values: Scalars, count: int) -> Array:
    """Add up values by numbers; `numpy.bincount` of no values gives integers."""
    return np.bincount(numbers, values, count).astype(np.float64)


def of_impossible(through: Scalars, beside: Scalars, weights: Weights) -> Scalars:
    """Give what pieces that cannot be where they are say of a pose, by the patches of each; never positive."""
    size = (through + weights.beside * beside) / weights.against_patches
    return np.asarray(weights.against * np.expm1(-size))
