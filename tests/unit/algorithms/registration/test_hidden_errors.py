"""A pose that hangs on one line is not to be trusted, however small its standard deviation."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.registration.pair_verdict import WORST_STD_M, largest_hidden_shift_m
from tests.scenes.lines.line_scenes import LineScene, observed_pair

POSE = RigidTransform.from_translation([7.0, 0.0, 0.0])
"""Without a turn, so that the components of the upright lines' offsets are along and across the facade."""


def hidden_shift_m(uprights: int) -> float:
    """Nine level lines of a facade along x, and some upright ones: the latter alone tell the place along it."""
    rng = np.random.default_rng(4)
    count = 9 + uprights
    points = rng.uniform(-0.5, 0.5, size=(count, 3)) * [12.0, 0.3, 6.0]
    directions = np.eye(3)[[0] * 9 + [2] * uprights]
    return largest_hidden_shift_m(observed_pair(LineScene(points, directions), rng, pose=POSE).adjusted())


def test_errors_of_a_line_that_alone_holds_the_pose_stay_hidden() -> None:
    assert hidden_shift_m(1) > 5.0 * WORST_STD_M


def test_several_lines_control_each_other() -> None:
    assert hidden_shift_m(6) < WORST_STD_M
