"""How often a piece moved between two simulated scans is named and left out, through extraction and matching."""

import numpy as np
import pytest

from tests.scenes.buildings.moved_furniture import MOVES, Outcome, outcome_of, register, simulate

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

SCANS_OF_EACH = 4


def test_moved_pieces_are_found_in_95_of_100_pairs_of_scans() -> None:
    outcomes: list[Outcome] = []
    noise = np.random.default_rng(6)
    for name in MOVES:
        for seed in range(SCANS_OF_EACH):
            furniture = simulate(name, seed, range_noise_m=float(noise.uniform(0.002, 0.006)))
            outcomes.append(outcome_of(furniture, register(furniture)))
            print(name, outcomes[-1])
    found = sum(outcome.named_planes >= 1 and outcome.wrong_used == 0 for outcome in outcomes) / len(outcomes)
    false = sum(outcome.good_removed for outcome in outcomes) / sum(outcome.good for outcome in outcomes)
    print(f"{len(outcomes)} pairs: found, named and left out {found:.0%}, good ones removed {false:.2%}")
    assert found >= 0.95
    assert false <= 0.01
