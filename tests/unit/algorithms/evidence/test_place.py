"""How probable the pose of a pair of scans is: the same from both sides, less where it is not the right one."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.evidence.calibration import Calibration
from algorithms.evidence.log_odds import Weights
from algorithms.evidence.place import Place, place_of
from tests.scenes.buildings.drawn_stations import DrawnStation, drawn_stations

pytestmark = pytest.mark.slow

WEIGHTS = Weights(1.0, 2.0, 1.0, 1.0, 0.5, 2.0, 0.3, 0.1, 1.5, 0.07, 10.0, -4.0, 2.0, -6.9)
CALIBRATION = Calibration(WEIGHTS, pairs=4000, accepted=2000, wrong=0)
ASIDE = RigidTransform.from_translation([0.0, 1.5, 0.0])


@cache
def stations() -> tuple[DrawnStation, DrawnStation]:
    first, second = drawn_stations("house", np.random.default_rng(4), count=2)
    return first, second


@cache
def truth() -> RigidTransform:
    target, source = stations()
    return target.world_from_reduced.inv() * source.world_from_reduced


def place(*poses: RigidTransform) -> Place:
    target, source = stations()
    return place_of(target.features, source.features, poses, CALIBRATION)


def test_the_right_pose_is_as_probable_as_the_calibration_can_carry() -> None:
    found = place(truth(), ASIDE * truth())
    assert found.probability == found.at_most == pytest.approx(1.0 - CALIBRATION.upper_95)
    assert found.fits > 0.0 > found.chosen


def test_a_wrong_pose_beside_the_right_one_is_not_probable_and_the_right_one_is_named() -> None:
    found = place(ASIDE * truth(), truth())
    assert found.probability < 0.01
    assert found.impossible < 0.0
    assert found.against[0].log_odds == min(piece.log_odds for piece in found.against)
    assert sum(piece.log_odds for piece in found.against) == pytest.approx(found.impossible)
    origins = [station.features.origin_m for station in stations()]
    named = found.others[0].target_from_source
    expected = RigidTransform.from_translation(origins[0]) * truth() * RigidTransform.from_translation(-origins[1])
    np.testing.assert_allclose(named.as_matrix(), expected.as_matrix(), atol=1e-9)
    assert found.others[0].probability > 0.99


def test_a_wrong_pose_alone_leaves_the_place_open() -> None:
    assert place(ASIDE * truth()).none > 0.5


def test_probabilities_sum_to_one() -> None:
    found = place(ASIDE * truth(), truth())
    named = sum(other.probability for other in found.others)
    assert found.probability + named + found.elsewhere + found.none == pytest.approx(1.0, abs=2e-4)


def test_exchanging_the_scans_exchanges_the_answer() -> None:
    target, source = stations()
    poses = [ASIDE * truth(), truth()]
    there = place_of(target.features, source.features, poses, CALIBRATION)
    back = place_of(source.features, target.features, [pose.inv() for pose in poses], CALIBRATION)
    assert back.probability == pytest.approx(there.probability)
    assert [piece.in_target for piece in back.against] == [not piece.in_target for piece in there.against]
    turned = back.others[0].target_from_source.inv()
    np.testing.assert_allclose(turned.as_matrix(), there.others[0].target_from_source.as_matrix(), atol=1e-9)
