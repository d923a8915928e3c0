"""A planted error is found, named and removed, and next to nothing else (fast form; 100 scenes each on request)."""

import numpy as np
import pytest

from algorithms.adjustment.options import AdjustmentOptions
from tests.scenes.buildings.plane_rooms import observed_rooms, plane_rooms
from tests.scenes.lines.planted_errors import PLANTED_ERRORS, adjusted, outcome_of

SCENES = 6
MOST_MISSED = 1
"""Where 95 % are found, more than one of six is missed in 3 % of such series."""
MOST_FALSE = 0.02
"""Share of good correspondences removed: 1 % is allowed in the long run."""


@pytest.mark.parametrize("error", PLANTED_ERRORS)
def test_a_planted_error_is_named_and_removed_and_hardly_anything_else(error: str) -> None:
    rng = np.random.default_rng(20)
    outcomes = []
    for _ in range(SCENES):
        planted = PLANTED_ERRORS[error](rng)
        outcomes.append(outcome_of(planted, adjusted(planted)))
    assert sum(not outcome.found for outcome in outcomes) <= MOST_MISSED
    assert sum(o.false_removals for o in outcomes) <= MOST_FALSE * sum(o.good for o in outcomes)


@pytest.mark.parametrize("seed", range(3))
def test_of_two_opposite_walls_of_a_bare_room_either_may_have_moved_and_both_are_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rooms = plane_rooms(rng, lines=12, rooms=1, bodies=0, matched_share=1.0)
    wall = int(rng.integers(4, 6))  # not those along which the ceiling slants: it would tell
    pair = observed_rooms(rooms, rng, source_rooms=rooms.with_plane_moved(wall, 0.05))
    assert pair.planes is not None
    removed = [removal for removal in pair.adjusted(AdjustmentOptions()).removals if removal.kind == "plane"]
    target, source = pair.planes.pairs[wall]
    assert len(removed) == 1
    is_removed = (removed[0].target_number, removed[0].source_number) == (target, source)
    assert is_removed or f"P{target + 1} – P{source + 1}" in removed[0].reason
    assert "cannot tell" in removed[0].reason
