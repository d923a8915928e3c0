"""Rank, tests, reliability, removals and refusals of the line adjustment."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_adjustment import AdjustmentOptions, LineAdjustment, adjust_lines
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.pair_adjustment import adjust_pair
from algorithms.adjustment.pair_problem import PairProblem
from algorithms.adjustment.rank import UserOrigins, analyse_rank
from algorithms.adjustment.snooping import CorrespondenceState, SnoopingRules, adjust_and_snoop
from algorithms.adjustment.testing import (
    GlobalVerdict,
    global_test,
    noncentrality,
    normal_critical_value,
    tau_critical_value,
)
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.weights import whitening_of
from algorithms.errors import InvalidInputError, TooFewCorrespondencesError
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays
from algorithms.geometry.planes import Planes

TILT_STD, OFFSET_STD = 1e-3, 1e-3
POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))
KEEP_ALL = AdjustmentOptions(max_removed_share=0.0)


def lines_along(directions: list[list[float]], rng: np.random.Generator) -> Lines:
    n = len(directions)
    covariances = np.tile(np.diag([TILT_STD**2, TILT_STD**2, OFFSET_STD**2, OFFSET_STD**2]), (n, 1, 1))
    return lines_from_arrays(
        rng.uniform(-3, 3, size=(n, 3)),
        np.array(directions, dtype=np.float64),
        covariances,
        np.tile([-1.0, 1.0], (n, 1)),
    )


def noisy(lines: Lines, rng: np.random.Generator) -> Lines:
    errors = rng.normal(size=(len(lines), 4)) * [TILT_STD, TILT_STD, OFFSET_STD, OFFSET_STD]
    return lines_from_arrays(
        lines.anchors + np.einsum("nij,nj->ni", lines.bases, errors[:, 2:]),
        lines.directions + np.einsum("nij,nj->ni", lines.bases, errors[:, :2]),
        lines.covariances,
        lines.extents,
    )


def same(n: int) -> np.ndarray:
    return np.repeat(np.arange(n, dtype=np.int64)[:, None], 2, axis=1)


def adjusted(lines: Lines, rng: np.random.Generator, options: AdjustmentOptions = KEEP_ALL) -> LineAdjustment:
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    return adjust_lines(target, source, same(len(lines)), POSE, options=options)


MIXED = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]]


def test_noisy_parallel_lines_leave_the_shift_along_them_free():
    rng = np.random.default_rng(1)
    result = adjusted(lines_along([[0, 0, 1]] * 6, rng), rng)
    axis = POSE.rotation.apply([0.0, 0.0, 1.0])
    assert result.rank == 5
    assert result.redundancy == 4 * 6 - 5
    assert abs(result.pose.null_space[3:, 0] @ axis) == pytest.approx(1.0, abs=1e-3)
    assert "translation along" in result.free_directions[0]
    assert "not parallel" in result.advice
    assert result.pose.translation_std_m == (None, None, None)
    assert None not in result.pose.rotation_std_rad


def test_coaxial_lines_leave_shift_and_turn_free():
    rng = np.random.default_rng(2)
    lines = lines_along([[0, 0, 1]] * 4, rng)
    lines = replace(lines, anchors=lines.anchors * [0.0, 0.0, 1.0])
    result = adjusted(lines, rng)
    assert result.rank == 4
    assert result.redundancy == 4 * 4 - 4
    assert [text.split(" ")[0] for text in result.free_directions] == ["translation", "rotation"]
    assert result.pose.omega_phi_kappa_std_rad == (None, None, None)


def test_the_free_turn_of_coaxial_lines_passes_through_their_axis():
    rng = np.random.default_rng(3)
    lines = lines_along([[0, 0, 1]] * 4, rng)
    lines = replace(lines, anchors=lines.anchors * [0.0, 0.0, 1.0] + [5.0, 0.0, 0.0])
    result = adjust_lines(lines, lines, same(4), RigidTransform.identity(), options=KEEP_ALL)
    turn = result.pose.null_space[:, 1] / np.linalg.norm(result.pose.null_space[:3, 1])
    on_axis = np.cross(turn[:3], np.array([5.0, 0.0, 1.0]) - result.pose.translation_m) + turn[3:]
    np.testing.assert_allclose(on_axis, 0.0, atol=1e-9)


def test_one_plane_leaves_three_motions_free():
    normal = np.array([[0.0, 0.0, 1.0]])
    plane = Planes(
        normals=normal,
        centroids=np.array([[1.0, 2.0, 3.0]]),
        bases=bases_of(normal),
        covariances=np.diag([1e-6, 1e-6, 1e-6])[None],
        noise_std_m=np.array([0.002]),
        point_counts=np.array([100]),
        areas_m2=np.array([1.0]),
        boundary=np.empty((0, 2)),
        boundary_splits=np.zeros(2, dtype=np.int64),
    )
    problem = PairProblem((PlanePlane(plane, plane, np.zeros((1, 2), dtype=np.int64)),))
    system = problem.at(RigidTransform.identity())
    whitened = whitening_of(system).apply(system.jacobian.toarray())
    origins = UserOrigins(np.zeros(3), np.zeros(3))
    report = analyse_rank(problem, system, whitened.T @ whitened, RigidTransform.identity(), origins)
    assert report.rank == 3


@pytest.mark.parametrize("count", [2, 6])
def test_crossing_lines_have_full_rank(count):
    rng = np.random.default_rng(4)
    result = adjusted(lines_along(MIXED[:count], rng), rng)
    assert result.rank == 6
    assert result.free_directions == ()
    assert result.pose.null_space.shape == (6, 0)
    assert result.weak == ()


def test_lines_in_one_plane_with_two_directions_are_not_weak():
    rng = np.random.default_rng(5)
    lines = lines_along([[1, 0, 0], [0, 1, 0]] * 6, rng)
    result = adjusted(replace(lines, anchors=lines.anchors * [1.0, 1.0, 0.0]), rng)
    assert result.rank == 6
    assert result.weak == ()


def test_nearly_parallel_lines_are_named_weak():
    rng = np.random.default_rng(6)
    result = adjusted(lines_along([[0, 0, 1]] * 4 + [[0.05, 0, 1]], rng), rng)
    assert result.rank == 6
    assert len(result.weak) == 1
    assert result.weak[0].description.startswith("translation along")
    assert result.weak[0].std_m > 0.01


def test_standard_deviation_is_smallest_near_the_features():
    rng = np.random.default_rng(7)
    lines = lines_along(MIXED, rng)
    result = adjusted(replace(lines, anchors=lines.anchors + np.array([100.0, 0.0, 0.0])), rng)
    at_features, at_origin = np.array(result.centroid_std_m), np.array(result.pose.translation_std_m)
    assert np.linalg.norm(at_features) < 0.1 * np.linalg.norm(at_origin)


def test_redundancy_numbers_add_up_to_the_redundancy():
    rng = np.random.default_rng(8)
    result = adjusted(lines_along(MIXED, rng), rng)
    assert result.lines.redundancy.sum() == pytest.approx(result.redundancy, abs=1e-9)
    assert (result.lines.redundancy > -1e-12).all()
    assert (result.lines.redundancy < 1 + 1e-12).all()


def test_statistic_of_a_line_is_the_drop_of_omega_without_it():
    rng = np.random.default_rng(9)
    lines = lines_along(MIXED, rng)
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    everything = adjust_lines(target, source, same(6), POSE, options=KEEP_ALL)
    without = adjust_lines(target, source, same(6)[:5], POSE, options=KEEP_ALL)
    # Exact in the linear model; products of errors are about 1e-3 of it.
    assert everything.lines.statistics[5] == pytest.approx(everything.omega - without.omega, rel=0.02)


def test_an_error_of_the_detectable_size_shifts_w_by_delta_zero():
    rng = np.random.default_rng(10)
    lines = lines_along(MIXED, rng)
    target, pairs = moved_lines(lines, POSE), same(6)
    clean = adjust_lines(target, lines, pairs, POSE, options=KEEP_ALL)
    size = clean.lines.detectable[2, 2]
    anchors = target.anchors.copy()
    anchors[2] -= size * target.bases[2, :, 0]
    disturbed = adjust_lines(replace(target, anchors=anchors), lines, pairs, POSE, options=KEEP_ALL)
    assert disturbed.lines.w[2, 2] == pytest.approx(noncentrality(0.001, 0.80), rel=0.01)


def test_external_effect_is_what_an_undetected_error_does_to_the_pose():
    rng = np.random.default_rng(11)
    lines = lines_along(MIXED, rng)
    target, pairs = moved_lines(lines, POSE), same(6)
    clean = adjust_lines(target, lines, pairs, POSE, options=KEEP_ALL)
    for k in range(6):
        for component in (2, 3):
            anchors = target.anchors.copy()
            anchors[k] -= clean.lines.detectable[k, component] * target.bases[k, :, component - 2]
            disturbed = adjust_lines(replace(target, anchors=anchors), lines, pairs, POSE, options=KEEP_ALL)
            moved = disturbed.pose.target_from_source * clean.pose.target_from_source.inv()
            shift = moved.apply(clean.centroid_m) - clean.centroid_m
            effect = clean.lines.effects[k, component]
            # first order: products of an effect with itself are below a percent of it
            np.testing.assert_allclose(moved.rotation.as_rotvec(), effect[:3], atol=0.01 * np.linalg.norm(effect[:3]))
            np.testing.assert_allclose(shift, effect[3:], atol=0.01 * np.linalg.norm(effect[3:]))


def test_two_lines_control_each_other_only_in_two_conditions():
    rng = np.random.default_rng(12)
    result = adjusted(lines_along(MIXED[:2], rng), rng)
    np.testing.assert_array_equal(result.lines.degrees, [2.0, 2.0])
    np.testing.assert_allclose(result.lines.statistics, result.omega, rtol=1e-6)


def test_optimistic_standard_deviations_fail_the_global_test_and_scale_the_covariance():
    rng = np.random.default_rng(13)
    lines = lines_along(MIXED, rng)
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    small = [replace(part, covariances=part.covariances / 25.0) for part in (target, source)]
    result = adjust_lines(small[0], small[1], same(6), POSE, options=KEEP_ALL)
    assert result.global_test.verdict is GlobalVerdict.TOO_LARGE
    assert result.variance_factor == pytest.approx(result.omega / result.redundancy)
    np.testing.assert_allclose(result.pose_a_posteriori.covariance, result.pose.covariance * result.variance_factor)


def test_pessimistic_standard_deviations_fail_on_the_low_side_and_scale_nothing():
    rng = np.random.default_rng(14)
    lines = lines_along(MIXED, rng)
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    large = [replace(part, covariances=part.covariances * 25.0) for part in (target, source)]
    result = adjust_lines(large[0], large[1], same(6), POSE, options=KEEP_ALL)
    assert result.global_test.verdict is GlobalVerdict.TOO_SMALL
    assert result.variance_factor == 1.0


def test_several_wrong_lines_are_removed_one_by_one_and_good_ones_stay():
    rng = np.random.default_rng(15)
    lines = lines_along(MIXED * 3, rng)
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    anchors = target.anchors.copy()
    for k, size in ((2, 0.02), (7, 0.5), (11, 0.06)):
        anchors[k] += size * target.bases[k, :, 1]
    result = adjust_lines(replace(target, anchors=anchors), source, same(18), POSE)
    assert [removal.correspondence for removal in result.removals] == [7, 11, 2]
    assert [removal.step for removal in result.removals] == [1, 2, 3]
    assert (result.lines.states == CorrespondenceState.REMOVED).sum() == 3
    assert result.global_test.verdict is GlobalVerdict.ACCEPTED


def test_a_good_line_removed_in_the_shadow_of_a_bad_one_comes_back():
    reinstated = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        lines = lines_along(MIXED, rng)
        target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
        anchors = target.anchors.copy()
        anchors[[0, 1]] += 0.02 * target.bases[[0, 1], :, 0]
        problem_target = replace(target, anchors=anchors)
        result = adjust_lines(problem_target, source, same(6), POSE)
        changes = [removal for removal in result.removals if removal.change == "reinstated"]
        reinstated += len(changes)
        for change in changes:
            assert change.statistic <= change.critical
            assert result.lines.states[change.correspondence] != CorrespondenceState.USED
    assert reinstated > 0


def test_no_more_than_the_allowed_share_is_removed():
    rng = np.random.default_rng(16)
    lines = lines_along(MIXED, rng)
    target = noisy(moved_lines(lines, POSE), rng)
    anchors = target.anchors + rng.uniform(-0.5, 0.5, size=(6, 3))
    options = AdjustmentOptions(max_removed_share=0.34)
    result = adjust_lines(replace(target, anchors=anchors), lines, same(6), POSE, options=options)
    assert (result.lines.states == CorrespondenceState.REMOVED).sum() <= 2
    assert result.global_test.verdict is GlobalVerdict.TOO_LARGE


def test_losing_the_only_crossing_line_lowers_the_rank():
    rng = np.random.default_rng(17)
    lines = lines_along([[0, 0, 1]] * 5 + [[1, 0, 0]], rng)
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    tilted = replace(target, directions=target.directions.copy())
    turned = tilted.directions[5] + 0.2 * target.bases[5, :, 0]
    tilted.directions[5] = turned / np.linalg.norm(turned)
    tilted = replace(tilted, bases=bases_of(tilted.directions))
    result = adjust_lines(tilted, source, same(6), POSE)
    assert [removal.correspondence for removal in result.removals] == [5]
    assert result.rank == 5


@pytest.mark.parametrize("pairs", [[[0, 0], [0, 1], [2, 2]], [[0, 0], [1, 0], [2, 2]]])
def test_a_line_matched_twice_is_refused(pairs):
    lines = lines_along(MIXED, np.random.default_rng(18))
    with pytest.raises(InvalidInputError, match="more than once"):
        adjust_lines(lines, lines, np.array(pairs, dtype=np.int64), POSE)


def test_a_line_that_does_not_exist_is_refused():
    lines = lines_along(MIXED, np.random.default_rng(19))
    with pytest.raises(InvalidInputError, match=r"not in 0\.\.5"):
        adjust_lines(lines, lines, np.array([[0, 0], [1, 6]], dtype=np.int64), POSE)


def test_lines_of_planes_without_covariance_are_refused():
    lines = lines_along(MIXED, np.random.default_rng(24))
    lines = replace(lines, parents=np.tile(np.array([[0, 7]], dtype=np.int64), (6, 1)))
    planes = np.tile(np.eye(3), (3, 1, 1))
    with pytest.raises(InvalidInputError, match="plane covariances"):
        adjust_lines(lines, lines, same(6), POSE, target_plane_covariances=planes)


def test_impossible_plane_covariances_are_refused():
    lines = lines_along(MIXED, np.random.default_rng(25))
    lines = replace(
        lines, parents=np.tile(np.array([[0, 1]], dtype=np.int64), (6, 1)), parent_jacobians=np.ones((6, 4, 6))
    )
    with pytest.raises(InvalidInputError, match="covariance of a plane"):
        adjust_lines(lines, lines, same(6), POSE, target_plane_covariances=np.tile(-np.eye(3), (2, 1, 1)))


@pytest.mark.parametrize("n", [0, 1])
def test_fewer_than_two_correspondences_are_refused(n):
    lines = lines_along(MIXED, np.random.default_rng(20))
    with pytest.raises(TooFewCorrespondencesError):
        adjust_lines(lines, lines, same(n), POSE)


def test_too_few_rounds_are_reported_as_not_converged():
    rng = np.random.default_rng(21)
    lines = lines_along(MIXED, rng)
    start = RigidTransform.from_components([2.3, -1.0, 0.5], Rotation.from_rotvec([0.1, 0.1, 0.0]) * POSE.rotation)
    options = AdjustmentOptions(max_iterations=1)
    assert not adjust_lines(moved_lines(lines, POSE), lines, same(6), start, options=options).converged


def test_offsets_are_reported_in_the_middle_of_the_common_piece():
    rng = np.random.default_rng(22)
    lines = lines_along(MIXED, rng)
    shifted = replace(lines, anchors=lines.anchors + 2.0 * lines.directions, extents=lines.extents - 2.0)
    target = moved_lines(lines, POSE)
    one = adjust_lines(noisy(target, np.random.default_rng(0)), lines, same(6), POSE, options=KEEP_ALL)
    two = adjust_lines(noisy(target, np.random.default_rng(0)), shifted, same(6), POSE, options=KEEP_ALL)
    # Moving a line's anchor along it changes its weight a little, yet not where offsets are measured.
    np.testing.assert_allclose(one.lines.offsets_m, two.lines.offsets_m, atol=1.5e-3)


def test_critical_values_are_those_of_the_textbooks():
    assert normal_critical_value(0.001) == pytest.approx(3.2905, abs=1e-4)
    assert noncentrality(0.001, 0.80) ** 2 == pytest.approx(17.075, abs=1e-3)
    tau = tau_critical_value(0.001, 6)
    assert tau is not None
    assert tau < np.sqrt(6)
    assert tau_critical_value(0.001, 1) is None


@pytest.mark.parametrize(
    ("omega", "verdict"),
    [(20.0, GlobalVerdict.ACCEPTED), (60.0, GlobalVerdict.TOO_LARGE), (2.0, GlobalVerdict.TOO_SMALL)],
)
def test_global_test_says_which_side(omega, verdict):
    test = global_test(omega, 20, 0.05)
    assert test.verdict is verdict
    assert stats.chi2.cdf(test.upper, 20) - stats.chi2.cdf(test.lower, 20) == pytest.approx(0.95)


def test_without_redundancy_nothing_is_tested():
    assert global_test(0.0, 0, 0.05).verdict is GlobalVerdict.NOT_TESTABLE


def test_planes_can_be_snooped_like_lines():
    rng = np.random.default_rng(23)
    normals = np.vstack([np.eye(3), -np.eye(3), np.eye(3)])
    planes = Planes(
        normals=normals,
        centroids=rng.uniform(-3, 3, size=(9, 3)),
        bases=bases_of(normals),
        covariances=np.tile(np.diag([1e-6, 1e-6, 1e-6]), (9, 1, 1)),
        noise_std_m=np.full(9, 0.002),
        point_counts=np.full(9, 100),
        areas_m2=np.ones(9),
        boundary=np.empty((0, 2)),
        boundary_splits=np.zeros(10, dtype=np.int64),
    )
    wrong = planes.centroids.copy()
    wrong[4] += 0.05 * normals[4]
    problem = PairProblem((PlanePlane(replace(planes, centroids=wrong), planes, same(9)),))
    result = adjust_and_snoop(
        problem,
        Unknowns.of_pair(RigidTransform.identity()),
        SnoopingRules(0.001, 0.5),
        partial(adjust_pair, origins=UserOrigins(np.zeros(3), np.zeros(3)), max_iterations=20),
    )
    assert np.flatnonzero(~result.used).tolist() == [4]
