"""How probable the pose of a pair of scans is: the same from both sides, less where it is not the right one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.evidence.calibration import Calibration
from algorithms.evidence.log_odds import Weights
from algorithms.evidence.place import Place, place_of
from tests.scenes.buildings.drawn_stations import DrawnStation, drawn_stations

pytestmark = pytest.mark.slow

WEIGHTS = Weights(0.65, 0.42, 1.55, 0.75, 0.26, 0.43, 0.7, 4.55, -6.9)
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


def place(*poses: RigidTransform, calibration: Calibration = CALIBRATION) -> Place:
    target, source = stations()
    return place_of(target.features, source.features, poses, calibration)


def test_the_right_pose_is_probable_and_ahead_of_the_other() -> None:
    found = place(truth(), ASIDE * truth())
    assert found.probability > 0.99
    assert found.free_space > 0.0 > found.chosen
    assert found.ahead > 0.0


def test_no_pose_is_more_probable_than_the_calibration_can_carry() -> None:
    few = replace(CALIBRATION, pairs=200, accepted=100)
    found = place(truth(), ASIDE * truth(), calibration=few)
    assert found.probability == found.at_most == pytest.approx(0.97, abs=0.001)


def test_a_wrong_pose_beside_the_right_one_is_not_probable_and_the_right_one_is_named() -> None:
    found = place(ASIDE * truth(), truth())
    assert found.probability < 0.01
    assert found.ahead < 0.0
    assert found.against[0].log_odds == min(piece.log_odds for piece in found.against) < 0.0
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
