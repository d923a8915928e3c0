"""Fit the constants of the evidence to frozen pairs, and show what a verdict by them is worth.

The pairs are those that `frozen` packed into `hypotheses.npz`. ``python -m tests.calibration.fit`` prints the table of
the gate with every kind of building judged by constants that were fitted on the others; ``--write`` fits on all and
writes `algorithms/evidence/calibration.json`.
"""

import json
import sys
from dataclasses import asdict, dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from algorithms.arrays import Array, Flags, Scalars
from algorithms.evidence.calibration import CALIBRATION, Calibration
from algorithms.evidence.log_odds import Counts, Weights, log_odds, pieces_of
from tests.calibration.frozen import ARCHIVE, Frozen

START = Weights(0.6, 0.4, 1.5, 0.75, 0.3, 0.5, 0.7, 4.0, -6.9)
"""Where the fit begins; `elsewhere` is held: no pair tells how often a place that no scan shows looks the same."""
RIDGE = 0.02
"""Weight of the square of how far a constant lies from where it starts: what the data do not tell stays there."""
RISK = 0.005


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


def fitted(pairs: Pairs, chosen: Flags, start: Weights = START) -> Weights:
    """Fit by maximum likelihood, never below zero: no evidence is turned round."""
    origin = np.array(list(asdict(START).values()))[:-1]

    def weights_of(vector: Array) -> Weights:
        return Weights(*vector.tolist(), START.elsewhere)

    def loss(vector: Array) -> float:
        ridge = RIDGE / max(chosen.sum(), 1) * float(np.sum((vector - origin) ** 2))
        return ridge - pairs.log_likelihood(weights_of(vector), chosen)

    begin = np.array(list(asdict(start).values()))[:-1]
    found = minimize(loss, begin, method="L-BFGS-B", bounds=[(0.0, None)] * len(origin), options={"maxiter": 200})
    return weights_of(found.x)


def held_out(pairs: Pairs, folds: int = 6) -> tuple[Scalars, Array, Array]:
    """Give (n,) probability of the best pose by constants fitted without its kind of building, its number, the fold."""
    buildings = np.array([name.split("/")[0] for name in pairs.of_pairs("building")])
    kinds = {name: k % folds for k, name in enumerate(np.unique(buildings))}
    fold = np.array([kinds[name] for name in buildings])
    probability, best = np.zeros(len(fold)), np.zeros(len(fold), dtype=int)
    weights = fitted(pairs, np.ones(len(fold), dtype=bool))
    for k in range(folds):
        poses, _, first = pairs.probabilities(fitted(pairs, fold != k, weights))
        probability[fold == k], best[fold == k] = poses[first][fold == k], first[fold == k]
    return probability, best, fold


def main() -> None:
    pairs = Pairs(Frozen.read(ARCHIVE).arrays)
    probability, best, _ = held_out(pairs)
    right = pairs.frozen["right"][best]
    print_table(pairs, probability, right)
    weights = fitted(pairs, np.ones(len(right), dtype=bool))
    print(json.dumps(asdict(weights), indent=1))
    if "--write" in sys.argv:
        accepted = probability >= 1.0 - RISK
        CALIBRATION.write_text(
            json.dumps(
                asdict(Calibration(weights, len(right), int(accepted.sum()), int((accepted & ~right).sum()))), indent=2
            )
            + "\n"
        )


def print_table(pairs: Pairs, probability: Scalars, right: Flags, risk: float = RISK) -> None:
    """Print acceptance by both verdicts, by family and by common surface, and the reliability."""
    status = pairs.of_pairs("status")
    ours, theirs = (probability >= 1.0 - risk) & pairs.of_pairs("precise"), status == "accepted"
    their_right = pairs.of_pairs("status_right")
    common, family = pairs.of_pairs("common"), pairs.of_pairs("family")
    classes = [("two places", ~pairs.of_pairs("same_place"))] + [
        (f"{low:.0%} to {high:.0%} in common", pairs.of_pairs("same_place") & (common >= low) & (common < high))
        for low, high in ((0.3, 1.01), (0.16, 0.3), (0.1, 0.16), (0.05, 0.1), (0.0, 0.05))
    ]
    for label, chosen in [
        *((str(name), family == name) for name in np.unique(family)),
        *classes,
        ("all", family != ""),
    ]:
        print(
            f"{label:26s} {chosen.sum():5d} pairs; model: accepted right {(chosen & ours & right).sum():4d}, wrong "
            f"{(chosen & ours & ~right).sum():3d}; rules: right {(chosen & theirs & their_right).sum():4d}, wrong "
            f"{(chosen & theirs & ~their_right).sum():3d}"
        )
    for low, high in (
        (0, 0.5),
        (0.5, 0.8),
        (0.8, 0.9),
        (0.9, 0.95),
        (0.95, 0.98),
        (0.98, 0.99),
        (0.99, 0.995),
        (0.995, 1.01),
    ):
        chosen = (probability >= low) & (probability < high)
        if chosen.any():
            print(
                f"said {low:.3f} to {min(high, 1):.3f}: {probability[chosen].mean():.4f}, "
                f"true {right[chosen].mean():.4f} of {chosen.sum()}"
            )


if __name__ == "__main__":
    main()
