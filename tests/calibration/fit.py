"""Fit the constants of the evidence to frozen pairs, and show what a verdict by them is worth.

The pairs are those that `frozen` packed into `hypotheses.npz`. ``python -m tests.calibration.fit`` prints the table of
the gate with every kind of building judged by constants that were fitted on the others; ``--write`` fits on all and
writes `algorithms/evidence/calibration.json`.
"""

import json
import sys
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from algorithms.arrays import Array, Flags, Scalars
from algorithms.evidence.calibration import CALIBRATION, Calibration
from algorithms.evidence.log_odds import Counts, Weights, log_odds
from algorithms.evidence.posterior import likeness_of, odds_beside
from tests.calibration.frozen import ARCHIVE, LIKE_POSES, Frozen

START = Weights(4.0, 2.0, 0.5, 1.0, 0.15, 1.5, 0.1, 0.1, 1.0, 0.05, 6.0, -3.0, 0.3, -6.0)
POSITIVE = {field.name for field in fields(Weights)} - {"repetition", "elsewhere", "chosen"}
"""Constants that are fitted by their logarithms."""
RIDGE = 0.02
"""Weight of the square of how far a constant lies from where it starts: what the data do not tell stays there."""
RISK = 0.005
HELD_ELSEWHERE = -6.9
"""No pair tells how often another place looks the same that no scan shows: held at one in a thousand."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Frozen pairs, ready to be weighed."""

    frozen: dict[str, Array]

    @cached_property
    def counts(self) -> Counts:
        """The evidence of all poses of all pairs."""
        f = self.frozen
        numbers = np.arange(len(f["right"]))
        found = f["lines"][:, 1].astype(float)
        return Counts(
            f["fitting"].astype(float),
            np.repeat(numbers, f["fitting_count"]),
            f["through"].astype(float),
            f["beside"].astype(float),
            np.repeat(numbers, f["against_count"]),
            found,
            f["lines"][:, 0] - found,
            f["features"].astype(float),
            f["control"].astype(float),
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

    @cached_property
    def likeness(self) -> Array:
        """(h, `LIKE_POSES`) of the motion from each of the first poses to each pose."""
        like = self.frozen["likeness"].astype(float)
        return np.column_stack([likeness_of(like[:, k, 0::2], like[:, k, 1::2]) for k in range(LIKE_POSES)])

    def of_pairs(self, name: str) -> Array:
        """Give a property of the pairs that have poses."""
        return self.frozen[name][self.frozen["pose_count"] > 0]

    def probabilities(self, weights: Weights) -> tuple[Scalars, Scalars, Array]:
        """Give (h,) probability of each pose, (n,) that of none of them, and (n,) the number of the best pose."""
        evidence = log_odds(self.counts, weights)
        total = evidence.total
        highest = np.maximum.reduceat(total, self.starts)
        order = np.lexsort((np.arange(len(total)), -total, self.pair))
        best = order[self.starts]
        column = np.minimum(best - self.starts, LIKE_POSES - 1)
        likeness = self.likeness[np.arange(len(total)), column[self.pair]]
        impossible = evidence.impossible
        odds = odds_beside(total, impossible, highest[self.pair], impossible[best][self.pair], likeness, weights)
        odds[best] = 1.0
        none = np.exp(np.clip(-highest, -500.0, 500.0)) + np.exp(weights.elsewhere)
        whole = np.add.reduceat(odds, self.starts) + none
        return odds / whole[self.pair], none / whole, best

    def log_likelihood(self, weights: Weights, chosen: Flags) -> float:
        """Give the mean logarithm of the probability of what is true, of the chosen pairs."""
        poses, none, _ = self.probabilities(weights)
        right = np.add.reduceat(np.where(self.frozen["right"], poses, 0.0), self.starts)
        any_right = np.logical_or.reduceat(self.frozen["right"], self.starts)
        return float(np.log(np.maximum(np.where(any_right, right, none), 1e-12))[chosen].mean())


def to_vector(weights: Weights) -> Array:
    return np.array([np.log(value) if name in POSITIVE else value for name, value in asdict(weights).items()])


def to_weights(vector: Array) -> Weights:
    names = [field.name for field in fields(Weights)]
    values = [
        float(np.exp(np.clip(v, -20, 20))) if name in POSITIVE else float(v)
        for name, v in zip(names, vector, strict=True)
    ]
    return replace(Weights(*values), elsewhere=HELD_ELSEWHERE)


def fitted(pairs: Pairs, chosen: Flags, start: Weights = START) -> Weights:
    """Fit by maximum likelihood."""
    origin = to_vector(START)

    def loss(vector: Array) -> float:
        return -pairs.log_likelihood(to_weights(vector), chosen) + RIDGE / max(chosen.sum(), 1) * float(
            np.sum((vector - origin) ** 2)
        )

    found = minimize(loss, to_vector(start), method="L-BFGS-B", options={"maxiter": 200})
    return to_weights(found.x)


def held_out(pairs: Pairs, folds: int = 6) -> tuple[Scalars, Array, Array]:
    """Give (n,) probability of the best pose by constants fitted without its kind of building, its number, the fold."""
    buildings = np.array([name.split("/")[0] for name in pairs.of_pairs("building")])
    kinds = {name: k % folds for k, name in enumerate(np.unique(buildings))}
    fold = np.array([kinds[name] for name in buildings])
    probability, best = np.zeros(len(fold)), np.zeros(len(fold), dtype=int)
    weights = fitted(pairs, np.ones(len(fold), dtype=bool))
    for k in range(folds):
        of_fold = fitted(pairs, fold != k, weights)
        poses, _, first = pairs.probabilities(of_fold)
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
    ours, theirs = probability >= 1.0 - risk, status == "accepted"
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
