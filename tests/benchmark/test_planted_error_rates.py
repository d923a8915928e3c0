"""A hundred scenes of each planted error: how many are found, named and removed, and how many good lines with them."""

import numpy as np
import pytest

from tests.scenes.lines.planted_errors import PLANTED_ERRORS, adjusted, outcome_of

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

SCENES = 100


@pytest.mark.parametrize("error", PLANTED_ERRORS)
def test_planted_errors_are_found_in_95_of_100_scenes(error: str) -> None:
    rng = np.random.default_rng(100)
    outcomes = []
    for _ in range(SCENES):
        planted = PLANTED_ERRORS[error](rng)
        outcomes.append(outcome_of(planted, adjusted(planted)))
    found = sum(outcome.found for outcome in outcomes) / SCENES
    false = sum(o.false_removals for o in outcomes) / sum(o.good for o in outcomes)
    print(f"{error}: found, named and removed {found:.0%}, good ones removed {false:.2%}")
    assert found >= 0.95
    assert false <= 0.01
