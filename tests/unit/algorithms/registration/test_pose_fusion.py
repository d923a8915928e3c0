"""Joining estimates of one pose: what the joined covariance promises, and when two estimates contradict each other."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.rank import CentredFrame
from algorithms.geometry.poses import PoseEstimate
from algorithms.registration.pose_fusion import FusionFrame, consistency, share_of_first

TRUTH = RigidTransform.from_components([3.0, -2.0, 0.7], Rotation.from_rotvec([0.4, -1.1, 0.2]))
FRAME = FusionFrame(TRUTH, CentredFrame(np.array([20.0, -5.0, 3.0]), 6.0))
RUNS = 200


def covariance(rng: np.random.Generator) -> np.ndarray:
    """Draw a covariance of (rotation vector [rad], translation [m]) with standard deviations of about a millimetre."""
    factors = rng.normal(size=(6, 6)) * np.array([1e-4] * 3 + [1e-3] * 3)[:, None]
    return np.asarray(factors @ factors.T + np.diag([1e-10] * 3 + [1e-8] * 3))


def drawn(true_covariance: np.ndarray, rng: np.random.Generator) -> RigidTransform:
    error = rng.multivariate_normal(np.zeros(6), true_covariance, method="cholesky")
    return moved(error)


def moved(error: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(
        np.asarray(TRUTH.translation) + error[3:], Rotation.from_rotvec(error[:3]) * TRUTH.rotation
    )


def error_of(pose: RigidTransform) -> np.ndarray:
    turn = (pose.rotation * TRUTH.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(pose.translation) - np.asarray(TRUTH.translation)])


@dataclass(frozen=True)
class Runs:
    nees: np.ndarray
    contradictions: np.ndarray


@cache
def runs(count: int) -> Runs:
    """Join two independent estimates again and again."""
    rng = np.random.default_rng(8)
    nees, contradictions = [], []
    for _ in range(count):
        covariances = covariance(rng), covariance(rng)
        parts = [FRAME.information(PoseEstimate(drawn(each, rng), each)) for each in covariances]
        joined = FRAME.estimate([(1.0, part) for part in parts])
        error = error_of(joined.target_from_source)
        nees.append(error @ np.linalg.solve(joined.covariance, error))
        contradictions.append(consistency(parts[0], parts[1], 0.05).contradicts)
    return Runs(np.array(nees), np.array(contradictions))


def test_the_joined_pose_of_two_independent_estimates_is_as_good_as_it_says() -> None:
    mean = runs(RUNS).nees.mean()
    low, high = stats.chi2.ppf([0.005, 0.995], 6 * RUNS) / RUNS
    assert low < mean < high


def test_good_estimates_contradict_each_other_as_often_as_the_level_says() -> None:
    count = int(runs(RUNS).contradictions.sum())
    assert stats.binom.ppf(0.005, RUNS, 0.05) <= count <= stats.binom.ppf(0.995, RUNS, 0.05)


def test_an_estimate_that_is_ten_standard_deviations_off_contradicts() -> None:
    own = covariance(np.random.default_rng(1))
    worst = np.linalg.eigh(own)[1][:, -1] * np.sqrt(np.linalg.eigvalsh(own)[-1])
    wrong = FRAME.information(PoseEstimate(moved(10.0 * worst), own))
    assert consistency(FRAME.information(PoseEstimate(TRUTH, own)), wrong, 0.001).contradicts


def test_joining_two_equal_estimates_halves_the_covariance() -> None:
    own = covariance(np.random.default_rng(2))
    part = FRAME.information(PoseEstimate(TRUTH, own))
    np.testing.assert_allclose(FRAME.estimate([(1.0, part), (1.0, part)]).covariance, 0.5 * own, rtol=1e-6, atol=1e-18)


def test_the_order_of_the_parts_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    parts = [(1.0, FRAME.information(PoseEstimate(drawn(c, rng), c))) for c in (covariance(rng), covariance(rng))]
    first, second = FRAME.estimate(parts), FRAME.estimate(parts[::-1])
    np.testing.assert_allclose(
        first.target_from_source.as_matrix(), second.target_from_source.as_matrix(), rtol=0.0, atol=1e-12
    )


def open_along(axis: np.ndarray, error: np.ndarray) -> PoseEstimate:
    """Give an estimate that leaves the shift along an axis open, and is anywhere along it."""
    null = np.concatenate([np.zeros(3), axis])[:, None]
    rest = np.eye(6) - null @ null.T
    own = rest @ np.diag([1e-8] * 3 + [1e-6] * 3) @ rest
    return PoseEstimate(moved(error), own, null)


def test_what_one_estimate_leaves_open_comes_from_the_other() -> None:
    along = open_along(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0]))
    across = open_along(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.0, -0.3, 0.0]))
    joined = FRAME.estimate([(1.0, FRAME.information(along)), (1.0, FRAME.information(across))])
    assert joined.null_space.shape == (6, 0)
    np.testing.assert_allclose(error_of(joined.target_from_source), 0.0, atol=1e-9)


def test_estimates_are_compared_only_where_both_determine_the_pose() -> None:
    along = open_along(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0]))
    full = PoseEstimate(TRUTH, np.diag([1e-8] * 3 + [1e-6] * 3))
    test = consistency(FRAME.information(along), FRAME.information(full), 0.001)
    assert test.degrees == 5
    assert test.statistic == pytest.approx(0.0, abs=1e-6)


def test_what_nobody_determines_stays_open() -> None:
    part = FRAME.information(open_along(np.array([0.0, 0.0, 1.0]), np.zeros(6)))
    null = FRAME.estimate([(1.0, part)]).null_space
    np.testing.assert_allclose(np.abs(null.ravel()), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0], atol=1e-6)


def test_a_motion_that_two_estimates_leave_open_is_not_determined_by_the_angle_between_theirs() -> None:
    along = FRAME.information(open_along(np.array([1.0, 0.0, 0.0]), np.zeros(6)))
    nearly = FRAME.information(open_along(np.array([np.cos(0.01), np.sin(0.01), 0.0]), np.zeros(6)))
    joined = FRAME.estimate([(1.0, along), (1.0, nearly)])
    assert joined.null_space.shape == (6, 1)
    assert np.abs(joined.null_space[3:, 0] / np.linalg.norm(joined.null_space)) == pytest.approx(
        [1.0, 0.0, 0.0], abs=0.02
    )


def test_estimates_from_the_same_data_never_add_up() -> None:
    """Twice the same errors: the mixture must not promise more than one of them."""
    own = FRAME.information(PoseEstimate(TRUTH, covariance(np.random.default_rng(4)))).matrix
    share = share_of_first(own, own)
    np.testing.assert_allclose(share * own + (1.0 - share) * own, own, rtol=1e-12)


def test_the_better_one_of_two_estimates_from_the_same_data_is_taken() -> None:
    good = 1e6 * np.eye(6)
    assert share_of_first(good, 0.1 * good) == pytest.approx(1.0, abs=1e-3)
    assert share_of_first(0.1 * good, good) == pytest.approx(0.0, abs=1e-3)


def test_the_mixture_promises_no_more_than_correlated_errors_allow() -> None:
    """Whatever the errors of both have in common, the mixture's true covariance stays below the one it states."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        first, second = covariance(rng), covariance(rng)
        parts = [FRAME.information(PoseEstimate(TRUTH, c)) for c in (first, second)]
        share = share_of_first(parts[0].matrix, parts[1].matrix)
        weights = share * parts[0].matrix, (1.0 - share) * parts[1].matrix
        stated = np.linalg.inv(weights[0] + weights[1])
        roots = [np.linalg.cholesky(np.linalg.inv(part.matrix)) for part in parts]
        correlation = np.linalg.qr(rng.normal(size=(6, 6)))[0]  # any orthogonal matrix: the errors determine each other
        cross = roots[0] @ correlation @ roots[1].T
        true = stated @ (
            weights[0] @ roots[0] @ roots[0].T @ weights[0]
            + weights[1] @ roots[1] @ roots[1].T @ weights[1]
            + weights[0] @ cross @ weights[1]
            + weights[1] @ cross.T @ weights[0]
        ) @ stated  # fmt: skip
        assert np.linalg.eigvalsh(stated - true).min() > -1e-9 * np.abs(stated).max()


def test_a_pose_that_holds_two_contradicting_estimates_is_within_its_deviations_of_either() -> None:
    rng = np.random.default_rng(21)
    sharp, blunt = covariance(rng), 9.0 * covariance(rng)
    wrong = np.array([0.0, 0.0, 0.0, 0.04, -0.03, 0.02])
    candidates = [PoseEstimate(moved(np.zeros(6)), sharp), PoseEstimate(moved(wrong), blunt)]
    parts = [FRAME.information(each) for each in candidates]
    joined = FRAME.estimate([(1.0, part) for part in parts])
    held = FRAME.holding_both(joined, *parts)
    errors = [error_of(each.target_from_source) - error_of(held.target_from_source) for each in candidates]
    assert all(error @ np.linalg.solve(held.covariance, error) <= 2.0 + 1e-6 for error in errors)
    assert max(error @ np.linalg.solve(joined.covariance, error) for error in errors) > 50.0
