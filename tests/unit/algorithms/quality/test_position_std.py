"""The stated standard deviation of each point is the scatter of points placed by poses drawn from the covariance."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.position_std import PositionStd

DRAWS = 40_000
POSE = RigidTransform.from_components([12.0, -7.0, 1.5], Rotation.from_rotvec([0.2, -0.1, 2.0]))
RANGE_STD_M = 0.002


def covariance_of(rng: np.random.Generator) -> np.ndarray:
    """Rotations of about 0.2 mrad, shifts of about 1 mm, all correlated."""
    factor = rng.normal(size=(6, 6)) * np.array([2e-4] * 3 + [1e-3] * 3)[:, None]
    return factor @ factor.T


def scatter_m(points: np.ndarray, covariance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Place points by drawn poses and ranges; give the root mean square of their distances from where they are."""
    drawn = rng.multivariate_normal(np.zeros(6), covariance, DRAWS)
    squares = np.zeros(len(points))
    for number, point in enumerate(points):
        ray = point / np.linalg.norm(point)
        measured = point + rng.normal(0.0, RANGE_STD_M, DRAWS)[:, None] * ray
        placed = (
            Rotation.from_rotvec(drawn[:, :3]).apply(POSE.rotation.apply(measured)) + POSE.translation + drawn[:, 3:]
        )
        squares[number] = ((placed - POSE.apply(point)) ** 2).sum(axis=1).mean()
    return np.sqrt(squares)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_is_the_scatter_of_drawn_poses_and_ranges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    covariance = covariance_of(rng)
    points = rng.uniform(-60.0, 60.0, (12, 3))
    stated = PositionStd(PoseEstimate(POSE, covariance), RANGE_STD_M).at(points, np.zeros(3))
    # a root mean square of 40 000 draws is known to 0.5 % or better; 4 of these
    assert stated == pytest.approx(scatter_m(points, covariance, rng), rel=0.02)


def test_it_is_the_trace_of_the_covariance_that_a_pose_tells_for_a_point() -> None:
    rng = np.random.default_rng(4)
    estimate = PoseEstimate(POSE, covariance_of(rng))
    points = rng.uniform(-60.0, 60.0, (20, 3))
    expected = [np.sqrt(np.trace(estimate.position_covariance_m2(POSE.apply(point)))) for point in points]
    assert PositionStd(estimate).at(points, np.zeros(3)) == pytest.approx(expected, rel=1e-12)


def test_far_coordinates_have_the_standard_deviations_of_near_ones() -> None:
    """The same scan, its frame shifted by 5400 km, and its pose with the covariance that belongs to that frame."""
    rng = np.random.default_rng(5)
    near = PoseEstimate(POSE, covariance_of(rng))
    points, origin_m = rng.uniform(-60.0, 60.0, (50, 3)), np.array([500_000.0, 5_400_000.0, 300.0])
    far = near.moved_to_origins(np.zeros(3), origin_m)
    expected = PositionStd(near, RANGE_STD_M).at(points, np.zeros(3))
    # squares of 5400 km times the rotation cancel to millimetres: seven digits are left of sixteen
    assert PositionStd(far, RANGE_STD_M).at(points, origin_m) == pytest.approx(expected, abs=1e-5)


def test_a_fixed_station_has_only_the_noise_of_its_ranges() -> None:
    fixed = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    assert PositionStd(fixed, RANGE_STD_M).at(np.ones((3, 3)), np.zeros(3)) == pytest.approx(RANGE_STD_M)
