"""A pose that leaves its height open stands on ground that both scans see, unless something better is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.rank import CentredFrame
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.priors import PairPriors, StationPrior
from algorithms.registration.base import FinalPose, PosePart, RegistrationProblem
from algorithms.registration.final_pose import MOST_TURN_BESIDE_PLANES, with_open_shift
from tests.scenes.lines.level_ground import ground

HEIGHT = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
PROBLEM = RegistrationProblem(ground([(0.0, 0.0, -1.5)], [15.0]), ground([(40.0, 10.0, -1.4)], [15.0]))


def pose_open_along(motion: np.ndarray) -> FinalPose:
    estimate = PoseEstimate(RigidTransform.identity(), np.diag([1e-8] * 3 + [1e-6, 1e-6, 0.0]), motion[:, None])
    frame = CentredFrame(np.zeros(3), 10.0)
    parts = (PosePart("surfaces", 1.0),)
    return FinalPose(estimate, estimate, frame, np.zeros(3), "surfaces", "as seen", parts, 0.0, None)


def with_approximate_poses() -> RegistrationProblem:
    known = PoseEstimate(RigidTransform.identity(), np.eye(6) * 1e-4)
    priors = PairPriors(StationPrior("A", world_from_scan=known), StationPrior("B", world_from_scan=known))
    return replace(PROBLEM, priors=priors)


def test_an_open_height_is_set_by_the_ground_and_stays_undetermined() -> None:
    found = with_open_shift(PROBLEM, pose_open_along(HEIGHT))
    for pose in (found.pose, found.reduced):
        np.testing.assert_allclose(pose.translation_m, [0.0, 0.0, -0.1], atol=1e-9)
        np.testing.assert_array_equal(pose.null_space, HEIGHT[:, None])
        assert pose.translation_std_m[2] is None
    assert "which nothing shows" in found.reason


def test_approximate_poses_outrank_the_ground() -> None:
    pose = pose_open_along(HEIGHT)
    assert with_open_shift(with_approximate_poses(), pose) is pose


@pytest.mark.parametrize("turn", [1.0, 2.0 * MOST_TURN_BESIDE_PLANES])
def test_an_open_turn_is_left_as_it_is(turn: float) -> None:
    motion = HEIGHT + np.array([turn, 0.0, 0.0, 0.0, 0.0, 0.0])
    pose = pose_open_along(motion / np.linalg.norm(motion))
    assert with_open_shift(PROBLEM, pose) is pose


def test_a_determined_pose_is_left_as_it_is() -> None:
    pose = pose_open_along(HEIGHT)
    whole = replace(pose, reduced=replace(pose.reduced, null_space=np.zeros((6, 0))))
    assert with_open_shift(PROBLEM, whole) is whole
