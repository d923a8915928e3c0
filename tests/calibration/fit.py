"""Fit the constants of the evidence to frozen pairs, and show what a verdict by them is worth.

The pairs are those that `frozen` packed into `hypotheses.npz`. ``python -m tests.calibration.fit`` prints the table of
the gate with every kind of building judged by constants that were fitted on the others; ``--write`` fits on all and
writes `algorithms/evidence/calibration.json` and what is to be said of it, `algorithms/evidence/RELIABILITY.md`.
"""

import json
import sys
from dataclasses import asdict

import numpy as np
from scipy.optimize import minimize

from algorithms.arrays import Array, Flags, Scalars
from algorithms.evidence.calibration import CALIBRATION, Calibration
from algorithms.evidence.log_odds import Weights
from tests.calibration.frozen import ARCHIVE, Frozen
from tests.calibration.pairs import Pairs
from tests.calibration.reliability import RISK, reliability

START = Weights(0.6, 0.4, 1.5, 0.75, 0.3, 0.5, 0.7, 4.0, -6.9)
"""Where the fit begins; `elsewhere` is held: no pair tells how often a place that no scan shows looks the same."""
RIDGE = 0.02
"""Weight of the square of how far a constant lies from where it starts: what the data do not tell stays there."""


def loss(pairs: Pairs, weights: Weights, chosen: Flags) -> float:
    """Give what the fit makes as small as it can."""
    away = np.array(list(asdict(weights).values())) - np.array(list(asdict(START).values()))
    return RIDGE / max(chosen.sum(), 1) * float(away @ away) - pairs.log_likelihood(weights, chosen)


def fitted(pairs: Pairs, chosen: Flags, start: Weights = START) -> Weights:
    """Fit by maximum likelihood, never below zero: no evidence is turned round."""

    def weights_of(vector: Array) -> Weights:
        return Weights(*vector.tolist(), START.elsewhere)

    begin = np.array(list(asdict(start).values()))[:-1]
    found = minimize(
        lambda vector: loss(pairs, weights_of(vector), chosen),
        begin,
        method="L-BFGS-B",
        bounds=[(0.0, None)] * len(begin),
        options={"maxiter": 200},
    )
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
    weights = fitted(pairs, np.ones(len(right), dtype=bool))
    accepted = probability >= 1.0 - RISK
    calibration = Calibration(weights, len(right), int(accepted.sum()), int((accepted & ~right).sum()))
    told = reliability(pairs, probability, right, calibration)
    print(told)
    if "--write" in sys.argv:
        CALIBRATION.write_text(json.dumps(asdict(calibration), indent=2) + "\n")
        CALIBRATION.with_name("RELIABILITY.md").write_text(told)


if __name__ == "__main__":
    main()
