"""Reliability as reported: limits, effects of undetected errors, what cannot be told apart, principal motions."""

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.critical_values import b_method_limit
from algorithms.adjustment.external_reliability import largest_effect
from algorithms.adjustment.line_adjustment import AdjustmentOptions, LineAdjustment, adjust_lines
from algorithms.adjustment.snooping import Change, CorrespondenceState
from algorithms.adjustment.testing import noncentrality
from algorithms.geometry.line_motion import moved_lines
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.pose_parameters import PoseParameters, parameter_rates, pose_parameters
from algorithms.geometry.poses import PoseEstimate

STD = 1e-3
POSE = RigidTransform.from_components([2.0, -1.0, 0.5], Rotation.from_rotvec([0.3, -0.8, 1.2]))
KEEP_ALL = AdjustmentOptions(max_removed_share=0.0)
MIXED = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1], [1, 0, 1]]


def lines_at(anchors: np.ndarray, directions: list[list[float]]) -> Lines:
    n = len(directions)
    return lines_from_arrays(
        anchors,
        np.array(directions, dtype=np.float64),
        np.tile(STD**2 * np.eye(4), (n, 1, 1)),
        np.tile([-1.0, 1.0], (n, 1)),
    )


def noisy(lines: Lines, rng: np.random.Generator, errors: np.ndarray | None = None) -> Lines:
    drawn = rng.normal(size=(len(lines), 4)) * STD + (0.0 if errors is None else errors)
    return lines_from_arrays(
        lines.anchors + np.einsum("nij,nj->ni", lines.bases, drawn[:, 2:]),
        lines.directions + np.einsum("nij,nj->ni", lines.bases, drawn[:, :2]),
        lines.covariances,
        lines.extents,
    )


def same(n: int) -> np.ndarray:
    return np.repeat(np.arange(n, dtype=np.int64)[:, None], 2, axis=1)


def mixed(rng: np.random.Generator) -> Lines:
    return lines_at(rng.uniform(-3, 3, size=(6, 3)), MIXED)


def clean(lines: Lines) -> LineAdjustment:
    return adjust_lines(moved_lines(lines, POSE), lines, same(len(lines)), POSE, options=KEEP_ALL)


@pytest.mark.parametrize(("dimension", "critical"), [(2, 11.73), (3, 12.63), (4, 13.54), (6, 15.35)])
def test_limits_of_the_b_method_are_baardas(dimension, critical):
    assert b_method_limit(dimension, 0.001, 0.80).critical == pytest.approx(critical, abs=0.005)


def test_the_limit_of_one_dimension_is_that_of_w():
    assert b_method_limit(1, 0.001, 0.80).critical == pytest.approx(stats.norm.isf(0.0005) ** 2, rel=1e-9)


def test_a_good_line_exceeds_the_b_method_limit_in_nine_of_a_thousand_cases():
    assert b_method_limit(4, 0.001, 0.80).alpha == pytest.approx(0.00893, abs=5e-6)


def test_a_low_power_has_a_limit_too():
    limit = b_method_limit(3, 0.05, 0.3)
    assert stats.ncx2.sf(limit.critical, 3, noncentrality(0.05, 0.3) ** 2) == pytest.approx(0.3, abs=1e-10)


@pytest.mark.slow
def test_errors_of_the_detectable_size_move_the_pose_on_average_by_the_reported_effect():
    rng = np.random.default_rng(1)
    lines = mixed(rng)
    report = clean(lines).lines
    target = moved_lines(lines, POSE)
    planted = np.zeros((6, 4))
    planted[2, 3] = -report.detectable[2, 3]  # the residual is source minus target
    errors = []
    for _ in range(80):
        result = adjust_lines(noisy(target, rng, planted), noisy(lines, rng), same(6), POSE, options=KEEP_ALL)
        moved = result.pose.target_from_source * POSE.inv()
        errors.append([*moved.rotation.as_rotvec(), *(moved.apply(result.centroid_m) - result.centroid_m)])
    mean, spread = np.mean(errors, axis=0), np.std(errors, axis=0) / np.sqrt(len(errors))
    # six means, each within four of its standard deviations: fails by chance once in 2600 seeds
    assert (np.abs(mean - report.effects[2, 3]) < 4.0 * spread).all()
    assert np.linalg.norm(mean) > 10.0 * np.linalg.norm(spread)


def test_the_global_effect_of_independent_lines_is_baardas_formula():
    lines = mixed(np.random.default_rng(2))
    report = clean(lines).lines
    # with equal, uncorrelated variances of all components (the scans see the same pieces)
    r = report.redundancy
    expected = noncentrality(0.001, 0.80) * np.sqrt((1.0 - r) / r)
    np.testing.assert_allclose(report.global_effects, expected, rtol=1e-6)


def test_effects_on_translations_follow_the_origin_while_that_at_the_centroid_stays():
    result = clean(mixed(np.random.default_rng(3)))
    origin = np.array([1e5, 2e5, 300.0])
    far = result.pose.moved_to_origins(origin, origin)
    motions, global_ = result.lines.effects.reshape(-1, 6), result.lines.global_effects.reshape(-1)
    here = largest_effect(motions, global_, result.pose.target_from_source, result.centroid_m)
    there = largest_effect(motions, global_, far.target_from_source, result.centroid_m + origin)
    assert there.centroid_m == here.centroid_m
    assert there.parameters[3:].max() > 1e3 * here.parameters[3:].max()
    np.testing.assert_allclose(there.parameters[:3], here.parameters[:3], rtol=1e-12)


def test_standard_deviations_of_residuals_belong_to_their_test_values():
    rng = np.random.default_rng(4)
    lines = mixed(rng)
    target, source = noisy(moved_lines(lines, POSE), rng), noisy(lines, rng)
    report = adjust_lines(target, source, same(6), POSE, options=KEEP_ALL).lines
    # uncorrelated components of one line: w is the residual over its standard deviation (to the tilt's small coupling)
    np.testing.assert_allclose(report.w, report.residuals / report.residual_std, rtol=0.05, atol=0.02)


def test_two_lines_that_control_only_each_other_are_named_together():
    rng = np.random.default_rng(5)
    directions = [[0, 0, 1]] * 8 + [[1, 0, 0]] * 2
    lines = lines_at(rng.uniform(-3, 3, size=(10, 3)), directions)
    planted = np.zeros((10, 4))
    up = np.array([0.0, 0.0, 1.0])
    target = moved_lines(lines, POSE)
    planted[8, 2:] = 0.05 * target.bases[8].T @ POSE.rotation.apply(up)
    result = adjust_lines(noisy(target, rng, planted), noisy(lines, rng), same(10), POSE)
    (removal,) = [entry for entry in result.removals if entry.change is Change.REMOVED]
    assert removal.correspondence in {8, 9}
    (partner,) = removal.inseparable_from
    assert {removal.correspondence, partner.block} == {8, 9}
    assert 0.9 < partner.correlation <= 1.0
    assert "cannot tell" in removal.reason


def test_a_wrong_line_among_many_good_ones_has_no_partner():
    rng = np.random.default_rng(6)
    lines = lines_at(rng.uniform(-3, 3, size=(12, 3)), MIXED * 2)
    planted = np.zeros((12, 4))
    planted[3, 2] = 0.05
    result = adjust_lines(noisy(moved_lines(lines, POSE), rng, planted), noisy(lines, rng), same(12), POSE)
    assert [(entry.correspondence, entry.inseparable_from) for entry in result.removals] == [(3, ())]


@pytest.mark.parametrize(
    ("component", "size", "word"), [(2, 0.05, "moved between"), (0, 0.05, "turned between"), (2, 1.5, "moved between")]
)
def test_reasons_say_in_words_what_happened(component, size, word):
    rng = np.random.default_rng(7)
    lines = lines_at(rng.uniform(-3, 3, size=(12, 3)), MIXED * 2)
    planted = np.zeros((12, 4))
    planted[3, component] = size
    result = adjust_lines(noisy(moved_lines(lines, POSE), rng, planted), noisy(lines, rng), same(12), POSE)
    assert result.removals[0].reason.startswith(word)
    assert result.lines.states[3] == CorrespondenceState.REMOVED


def test_a_line_elsewhere_in_another_direction_is_called_a_wrong_correspondence():
    rng = np.random.default_rng(8)
    lines = lines_at(rng.uniform(-3, 3, size=(12, 3)), MIXED * 2)
    planted = np.zeros((12, 4))
    planted[3] = [0.1, 0.0, 0.8, 0.0]
    result = adjust_lines(noisy(moved_lines(lines, POSE), rng, planted), noisy(lines, rng), same(12), POSE)
    assert result.removals[0].reason.startswith("wrong correspondence")


def test_axes_of_the_error_ellipsoid_are_roots_of_the_eigenvalues():
    result = clean(mixed(np.random.default_rng(9)))
    ellipsoid = result.pose.error_ellipsoid(result.centroid_m)
    values = np.linalg.eigvalsh(result.pose.position_covariance_m2(result.centroid_m))
    np.testing.assert_allclose(ellipsoid.semi_axes_m, np.sqrt(values[::-1]), rtol=1e-9)


def test_principal_motions_are_as_many_as_the_rank():
    rng = np.random.default_rng(10)
    assert len(clean(mixed(rng)).principal_motions) == 6
    parallel = lines_at(rng.uniform(-3, 3, size=(6, 3)), [[0, 0, 1]] * 6)
    result = adjust_lines(noisy(moved_lines(parallel, POSE), rng), noisy(parallel, rng), same(6), POSE)
    assert len(result.principal_motions) == 5


def test_principal_motions_carry_the_whole_covariance_at_the_centroid():
    result = clean(mixed(np.random.default_rng(11)))
    total = sum(motion.std_m**2 * np.outer(motion.shift, motion.shift) for motion in result.principal_motions)
    np.testing.assert_allclose(total, result.pose.position_covariance_m2(result.centroid_m), rtol=1e-8, atol=1e-16)


def test_the_worst_principal_motion_comes_first_and_is_named():
    rng = np.random.default_rng(12)
    lines = lines_at(rng.uniform(-3, 3, size=(6, 3)), [[0, 0, 1]] * 5 + [[0.1, 0, 1]])
    motions = clean(lines).principal_motions
    assert motions[0].text.startswith("translation along")
    assert [motion.std_m for motion in motions] == sorted((m.std_m for m in motions), reverse=True)


def test_covariance_of_the_parameters_agrees_with_drawn_poses():
    rng = np.random.default_rng(13)
    root = rng.normal(size=(6, 6)) * 1e-4
    pose = PoseEstimate(POSE, root @ root.T)
    drawn = rng.multivariate_normal(np.zeros(6), pose.covariance, size=4000)
    values = [
        pose_parameters(
            PoseEstimate(
                RigidTransform.from_components(POSE.translation + d[3:], Rotation.from_rotvec(d[:3]) * POSE.rotation),
                pose.covariance,
            )
        ).values
        for d in drawn[:800]
    ]
    expected = pose_parameters(pose).covariance
    # a correlation from 800 draws has a standard deviation of at most 0.035
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(np.array(values).T) / scale, expected / scale, atol=0.15)


def test_only_strong_correlations_of_determined_parameters_are_listed():
    covariance = np.eye(6)
    covariance[0, 4] = covariance[4, 0] = -0.95
    covariance[1, 2] = covariance[2, 1] = 0.99
    covariance[3, 5] = covariance[5, 3] = 0.5
    determined = np.array([True, True, False, True, True, True])
    parameters = PoseParameters(np.zeros(6), covariance, determined, ~determined)
    assert parameters.correlations_above(0.9) == [(0, 4, -0.95)]


def test_omega_and_kappa_are_not_separable_at_a_right_angle_of_phi():
    rates, separable = parameter_rates(Rotation.from_euler("XYZ", [0.3, np.pi / 2, 0.0]))
    assert separable.tolist() == [False, True, False, True, True, True]
    assert (rates[[0, 2]] == 0.0).all()
