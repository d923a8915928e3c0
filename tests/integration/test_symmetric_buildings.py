"""Buildings that look like themselves elsewhere: the answer says so, instead of choosing."""

import pytest
from symmetric_pairs import symmetric_pair

from algorithms.registration.base import PairStatus
from algorithms.simulation.symmetric_scenes import SYMMETRIC_SCENES


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_a_symmetric_building_is_called_ambiguous_with_the_reason(name: str) -> None:
    pair = symmetric_pair(name, 1, 0)
    assert pair.status is PairStatus.AMBIGUOUS
    assert any("another pose" in reason or "different pose" in reason for reason in pair.reasons)
