"""From scans to removals: a door leaf or a cupboard moved by 5 cm between the scans is found, named and left out."""

import pytest

from tests.scenes.buildings.moved_furniture import outcome_of, register, simulate

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("piece", ["door leaf", "fridge"])
def test_a_piece_moved_between_the_scans_is_named_and_left_out_and_nothing_else(piece: str) -> None:
    furniture = simulate(piece, seed=1)
    outcome = outcome_of(furniture, register(furniture))
    assert outcome.named_planes >= 1
    assert outcome.wrong_used == 0
    assert outcome.good_removed == 0
