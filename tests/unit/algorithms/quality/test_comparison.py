"""Comparison with a reference: differences, their significance, and the level of the joint test."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.angles import GON_PER_RAD, rotation_from_angles
from algorithms.geometry.pose_parameters import pose_parameters, pose_with_parameter_std
from algorithms.geometry.poses import PoseEstimate
from algorithms.quality.accuracy import accuracy_figures
from algorithms.quality.comparison import compare_poses

POSE = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.4, -0.2, 1.0]))
FLAWLESS = PoseEstimate(POSE, np.zeros((6, 6)))


def some_covariance(seed: int, size: float = 1e-3) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(6, 6)) * size
    return root @ root.T


def perturbed(pose: RigidTransform, step: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(
        np.asarray(pose.translation) + step[3:], Rotation.from_rotvec(step[:3]) * pose.rotation
    )


def of_gon(omega: float, phi: float, kappa: float, shift: list[float]) -> PoseEstimate:
    angles = np.array([omega, phi, kappa]) / GON_PER_RAD
    return PoseEstimate(RigidTransform.from_components(shift, rotation_from_angles(*angles)), np.zeros((6, 6)))


def test_mean_differences_are_those_of_the_dissertations_table_4_4():
    lines = of_gon(0.1686, 0.2932, -48.4440, [-1.374, -9.525, -0.037])
    targets = of_gon(0.5246, 0.6096, -48.4035, [-1.374, -9.515, -0.063])
    comparison = compare_poses(lines, targets, 0.05)
    assert comparison.mean_rotation_rad * GON_PER_RAD == pytest.approx(0.2376, abs=1e-4)
    assert comparison.mean_translation_m == pytest.approx(0.012, abs=5e-4)


@pytest.mark.slow
def test_a_perfect_registration_fails_the_joint_test_as_often_as_its_level_says():
    rng = np.random.default_rng(1)
    ours, theirs = some_covariance(2), some_covariance(3)
    steps = [rng.multivariate_normal(np.zeros(6), c, size=600) for c in (ours, theirs)]
    significant = [
        compare_poses(PoseEstimate(perturbed(POSE, a), ours), PoseEstimate(perturbed(POSE, b), theirs), 0.05).joint
        for a, b in zip(*steps, strict=True)
    ]
    rejected = sum(test is not None and test.significant for test in significant)
    # within four standard deviations of the binomial count
    assert abs(rejected - 30) < 4.0 * np.sqrt(600 * 0.05 * 0.95)


def test_the_statistic_of_a_known_difference_is_its_mahalanobis_length():
    covariance = some_covariance(4)
    step = np.array([1e-3, -2e-3, 0.5e-3, 0.004, -0.001, 0.002])
    joint = compare_poses(PoseEstimate(perturbed(POSE, step), covariance), FLAWLESS, 0.05).joint
    assert joint is not None
    assert joint.statistic == pytest.approx(step @ np.linalg.solve(covariance, step), rel=1e-6)
    assert (joint.degrees_of_freedom, joint.critical) == (6, pytest.approx(12.592, abs=1e-3))
    assert joint.p_value == pytest.approx(stats.chi2.sf(joint.statistic, 6))


def test_the_reference_s_own_standard_deviation_counts():
    estimate = pose_with_parameter_std(POSE, np.array([1e-4, 1e-4, 1e-4, 0.003, 0.003, 0.003]))
    shifted = RigidTransform.from_components(np.add(POSE.translation, [0.01, 0.0, 0.0]), POSE.rotation)
    rough = pose_with_parameter_std(shifted, np.array([1e-4, 1e-4, 1e-4, 0.004, 0.004, 0.004]))
    against_truth = compare_poses(estimate, PoseEstimate(shifted, np.zeros((6, 6))), 0.05).parameters[3]
    against_rough = compare_poses(estimate, rough, 0.05).parameters[3]
    assert (against_truth.std, against_rough.std) == pytest.approx((0.003, 0.005))
    assert (against_truth.significant, against_rough.significant) == (True, True)
    assert (against_truth.ratio, against_rough.ratio) == pytest.approx((10 / 3, 2.0))


def test_differences_of_angles_go_the_short_way_round():
    comparison = compare_poses(of_gon(0, 0, 199.99, [0, 0, 0]), of_gon(0, 0, -199.99, [0, 0, 0]), 0.05)
    assert comparison.parameters[2].difference * GON_PER_RAD == pytest.approx(-0.02, abs=1e-9)


def test_without_standard_deviations_nothing_is_called_significant():
    comparison = compare_poses(of_gon(0, 0, 1, [0, 0, 0]), of_gon(0, 0, 2, [0, 0, 0]), 0.05)
    assert comparison.joint is None
    assert {parameter.significant for parameter in comparison.parameters} == {None}


def test_what_is_free_takes_no_part_in_the_joint_test():
    free = np.array([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]])
    covariance = np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 0.0])
    estimate = PoseEstimate(RigidTransform.from_components([3.0, -2.0, 77.0], POSE.rotation), covariance, free)
    comparison = compare_poses(estimate, FLAWLESS, 0.05)
    assert comparison.joint is not None
    assert (comparison.joint.degrees_of_freedom, comparison.joint.significant) == (5, False)
    assert comparison.parameters[5].std is None


def test_standard_deviations_of_parameters_survive_the_way_there_and_back():
    std = np.array([1e-4, 2e-4, 3e-4, 0.001, 0.002, 0.003])
    back = pose_parameters(pose_with_parameter_std(POSE, std)).covariance
    np.testing.assert_allclose(back, np.diag(std**2), atol=1e-18)


def test_figures_speak_of_used_lines_only():
    figures = accuracy_figures(
        PoseEstimate(POSE, some_covariance(5)),
        used=np.array([True, True, False]),
        angles_rad=np.array([1e-3, 2e-3, 9e-3]),
        shortest_distances_m=np.array([0.001, 0.0, 0.5]),
        offsets_m=np.array([[0.003, 0.004], [0.0, 0.001], [0.3, 0.4]]),
        normalised=np.array([[1.0, -3.0, 0.5, 0.0], [0.1, 0.2, 0.3, 0.0], [50.0, 0.0, 0.0, 0.0]]),
        controlled=np.array([[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, 1.0]]),
        sigma0=1.5,
    )
    assert (figures.max_angle_rad, figures.max_shortest_distance_m, figures.max_offset_m) == (2e-3, 0.001, 0.005)
    assert figures.max_normalised == 2.0
    assert figures.share_beyond_196 == pytest.approx(1 / 7)


def test_mean_standard_deviations_of_an_undetermined_pose_are_not_given():
    free = np.array([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]])
    none = np.empty(0)
    figures = accuracy_figures(
        PoseEstimate(POSE, np.zeros((6, 6)), free),
        used=np.empty(0, dtype=bool),
        angles_rad=none,
        shortest_distances_m=none,
        offsets_m=np.empty((0, 2)),
        normalised=np.empty((0, 4)),
        controlled=np.empty((0, 4)),
        sigma0=None,
    )
    assert figures.mean_std_translation_m is None
    assert figures.max_angle_rad is None
    assert figures.share_beyond_196 is None
