"""A camera that does not sit where it was said to: found as one gross error, and trusted less."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from algorithms.adjustment.gross_errors import GrossErrorSearch
from algorithms.adjustment.line_adjustment import LineAdjustment, adjust_lines
from algorithms.adjustment.mount_errors import estimated_error
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.pair_problem import PairProblem, by_station
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.adjustment.solver import solve
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array
from algorithms.geometry.line_differences import lines_moved
from tests.scenes.lines.line_scenes import ObservedPair, generic_lines, normalised_error, observed_pair

ROTATION_STD_RAD, SHIFT_STD_M = 2e-5, 1e-4
MOUNT = np.diag([ROTATION_STD_RAD**2] * 3 + [SHIFT_STD_M**2] * 3)
TURN_RAD = 0.1 * np.pi / 200.0
WRONG = np.array([0.0, TURN_RAD, 0.0, 0.0, 0.0, 0.0])
IN_PHOTO = 12


def scene(seed: int, error: Array) -> ObservedPair:
    """Sixteen lines of which the source sees twelve in a photo; the mount's error turns and shifts these."""
    rng = np.random.default_rng(seed)
    pair = observed_pair(generic_lines(rng, 16), rng, noise_m=0.0003)
    source = pair.source
    photos = np.where(np.arange(16) < IN_PHOTO, 0, -1).astype(np.int32)
    jacobians = np.zeros((16, 4, 6))
    for k in range(IN_PHOTO):
        for axis in range(3):
            turned = np.cross(np.eye(3)[axis], source.directions[k])
            swept = np.cross(np.eye(3)[axis], source.anchors[k])
            jacobians[k, :2, axis] = source.bases[k].T @ turned
            jacobians[k, 2:, axis] = source.bases[k].T @ swept
        jacobians[k, 2:, 3:] = source.bases[k].T
    through = jacobians @ MOUNT @ np.swapaxes(jacobians, 1, 2)
    drawn = error + rng.multivariate_normal(np.zeros(6), MOUNT)
    moved = lines_moved(source, jacobians @ drawn)
    return replace(
        pair,
        source=replace(moved, covariances=moved.covariances + through, photos=photos, photo_jacobians=jacobians),
    )


def registered(pair: ObservedPair, *, options: AdjustmentOptions | None = None) -> LineAdjustment:
    return adjust_lines(
        pair.target,
        pair.source,
        pair.correspondences,
        pair.start,
        source_photo_covariances=MOUNT[None],
        options=options or AdjustmentOptions(),
    )


def test_a_mount_as_good_as_stated_is_trusted() -> None:
    found = [registered(scene(seed, np.zeros(6))).mount_errors for seed in range(20)]
    assert [len(errors) for errors in found] == [0] * 20


def test_a_wrong_mount_is_found_with_its_size() -> None:
    (found,) = registered(scene(1, WRONG)).mount_errors
    assert found.photo == (1, 0)
    np.testing.assert_allclose(found.error[:3], WRONG[:3], atol=5.0 * np.sqrt(found.covariance[:3, :3].max()))


def test_lines_of_a_wrong_mount_stay_in_use() -> None:
    result = registered(scene(1, WRONG))
    assert (result.lines.states == CorrespondenceState.USED).all()


@pytest.mark.slow
def test_poses_with_a_wrong_mount_are_consistent_with_their_covariance() -> None:
    normalised = []
    for seed in range(20):
        pair = scene(100 + seed, WRONG)
        normalised.append(normalised_error(registered(pair), pair.pose))
    # twenty values of chi-square with six degrees of freedom, at 0.1 % on either side
    low, high = stats.chi2.ppf([0.001, 0.999], 120) / 20
    assert low < np.mean(normalised) < high


def test_words_name_the_photo_and_the_global_test() -> None:
    words = registered(scene(1, WRONG)).mount_errors[0].in_words()
    assert "photo 1 of the source" in words
    assert "the global test fails" in words
    assert " gon (std " in words


def test_nothing_is_changed_where_tests_must_not_remove() -> None:
    options = AdjustmentOptions(max_removed_share=0.0)
    assert registered(scene(1, WRONG), options=options).mount_errors == ()


def test_the_test_value_of_a_mount_is_the_drop_of_omega_when_its_errors_are_unknowns() -> None:
    pair = scene(3, WRONG)
    problem = PairProblem(
        (LineLine(pair.target, pair.source, pair.correspondences),), {}, by_station(None, MOUNT[None])
    )
    solution = solve(problem, Unknowns.of_pair(pair.start), np.zeros((6, 0)), 20)
    system, whitening = solution.system, solution.whitening
    tests = GrossErrorSearch(solution).tests()
    (k,) = [k for k, photo in enumerate(tests.photos) if photo is not None]
    design = [whitening.apply(system.jacobian.toarray()), whitening.apply(system.photo_factors[1].toarray())]
    extended = np.hstack(design)
    extended = extended / np.linalg.norm(extended, axis=0)
    residuals = whitening.apply(system.residuals)
    left = residuals - extended @ np.linalg.lstsq(extended, residuals, rcond=1e-9)[0]
    assert tests.statistics[k] == pytest.approx(solution.omega - left @ left, rel=1e-6)


def test_an_error_that_chance_explains_is_estimated_as_none() -> None:
    error, covariance = estimated_error(np.full(6, 0.1), np.eye(6), degrees=6.0)
    assert np.abs(error).max() < 1e-3
    assert covariance.max() < 1e-3


def test_an_error_that_hardly_shows_does_not_run_away() -> None:
    own = np.diag([100.0, 100.0, 100.0, 100.0, 100.0, 1e-6])
    error, _ = estimated_error(own @ np.full(6, 5.0) + np.array([0, 0, 0, 0, 0, 1e-3]), own, degrees=6.0)
    np.testing.assert_allclose(error[:5], 5.0, rtol=0.02)
    assert abs(error[5]) < 5.0
