"""A copy is told from a second measurement by its points."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.quality.same_points import SAME_SHARE, shared_points
from tests.unit.algorithms.scans.test_far_points import ROOM, room

MOTION = RigidTransform.from_components([3.0, -2.0, 0.5], Rotation.from_euler("zyx", [1.2, 0.1, -0.2]))
NEARLY = RigidTransform.from_components([0.002, -0.001, 0.001], Rotation.from_rotvec([1e-4, 2e-4, -1e-4])) * MOTION
REACH_M = 0.3


@pytest.mark.parametrize(
    "copy",
    [ROOM, ROOM[::7], ROOM[ROOM[:, 0] < 0.0], np.round(ROOM, 3)],
    ids=["whole", "thinned", "cut", "rounded to millimetres"],
)
def test_a_copy_is_found_again_after_a_pose_that_is_only_nearly_right(copy: np.ndarray) -> None:
    assert shared_points(copy, MOTION.apply(ROOM), NEARLY, REACH_M) > 0.9


def test_points_that_a_file_holds_twice_are_found_again_too() -> None:
    assert shared_points(ROOM[::5], np.repeat(ROOM, 2, axis=0), RigidTransform.identity(), REACH_M) > 0.9


@pytest.mark.parametrize("noise_m", [0.0, 0.002])
def test_a_second_measurement_of_the_same_walls_is_none(noise_m: float) -> None:
    again = room()
    again = again + np.random.default_rng(2).normal(size=again.shape) * noise_m
    assert shared_points(again, MOTION.apply(ROOM), MOTION, REACH_M) < 0.5 * SAME_SHARE


def test_scans_that_do_not_meet_share_nothing() -> None:
    assert shared_points(ROOM + 100.0, ROOM, RigidTransform.identity(), REACH_M) == 0.0


def test_many_points_are_not_found_again_in_one() -> None:
    """A small scan that lies between two points of a scan in another unit is near one of them as a whole."""
    assert shared_points(0.01 * ROOM, 1000.0 * ROOM, RigidTransform.identity(), 1000.0) < 0.1 * SAME_SHARE
