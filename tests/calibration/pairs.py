"""Frozen pairs, weighed by the model of the evidence."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from algorithms.arrays import Array, Flags, Scalars
from algorithms.evidence.log_odds import Counts, Weights, log_odds, pieces_of


@dataclass(frozen=True, eq=False)
class Pairs:
    """Frozen pairs, ready to be weighed; those in which no pose was found are left out."""

    frozen: dict[str, Array]

    @cached_property
    def counts(self) -> Counts:
        """The evidence of all poses of all pairs."""
        f, h = self.frozen, len(self.frozen["right"])
        fitting = np.repeat(np.arange(h), f["fitting_count"])
        against = np.repeat(np.arange(h), f["against_count"])
        patches = f["fitting"].astype(np.float64)

        def sums(numbers: Array, values: Array) -> Array:
            return np.bincount(numbers, values, h).astype(np.float64)

        return Counts(
            sums(fitting, patches),
            sums(against, f["through"].astype(np.float64)),
            sums(against, f["beside"].astype(np.float64)),
            sums(fitting, pieces_of(patches)),
            f["against_count"].astype(np.float64),
            f["control"].astype(np.float64),
            self.pair,
        )

    @cached_property
    def starts(self) -> Array:
        """(n,) number of the first pose of each pair that has any."""
        counts = self.frozen["pose_count"]
        return (np.cumsum(counts) - counts)[counts > 0]

    @cached_property
    def pair(self) -> Array:
        """(h,) number of the pair of each pose, among those that have poses."""
        counts = self.frozen["pose_count"]
        return np.repeat(np.arange(np.count_nonzero(counts)), counts[counts > 0])

    def of_pairs(self, name: str) -> Array:
        """Give a property of the pairs that have poses."""
        return self.frozen[name][self.frozen["pose_count"] > 0]

    def probabilities(self, weights: Weights) -> tuple[Scalars, Scalars, Array]:
        """Give (h,) probability of each pose, (n,) that of none of them, and (n,) the number of the best pose."""
        total = log_odds(self.counts, weights).total
        best = np.lexsort((-total, self.pair))[self.starts]
        largest = np.maximum(total[best], 0.0)
        odds, none = np.exp(total - largest[self.pair]), np.exp(-largest)
        whole = np.add.reduceat(odds, self.starts) + none + np.exp(total[best] + weights.elsewhere - largest)
        return odds / whole[self.pair], none / whole, best

    def log_likelihood(self, weights: Weights, chosen: Flags) -> float:
        """Give the mean logarithm of the probability of what is true, of the chosen pairs."""
        poses, none, _ = self.probabilities(weights)
        right = np.add.reduceat(np.where(self.frozen["right"], poses, 0.0), self.starts)
        any_right = np.logical_or.reduceat(self.frozen["right"], self.starts)
        return float(np.log(np.maximum(np.where(any_right, right, none), 1e-12))[chosen].mean())
