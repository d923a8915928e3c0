"""Lichtenstein's and Alshawa's estimators: exact where they must be, refused where they cannot, honest about noise."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.alshawa import adjust_alshawa
from algorithms.adjustment.line_estimate import LineEstimate, closeness
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.plucker_adjustment import adjust_plucker, plucker_solution
from algorithms.adjustment.residual_covariance import NOTHING_SHARED, SharedErrors, residual_covariance
from algorithms.errors import DegenerateGeometryError, InvalidInputError, TooFewCorrespondencesError
from algorithms.geometry.angles import rotation_from_angles
from algorithms.geometry.line_motion import lines_about, moved_lines
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.plucker import plucker_coordinates, plucker_motion
from tests.scenes.buildings.plane_rooms import observed_rooms, plane_rooms
from tests.scenes.lines.line_scenes import (
    LINE_SCENES,
    LineScene,
    ObservedPair,
    generic_lines,
    observed_pair,
    one_line_shifted,
    pose_error,
    random_motion,
)

EXACT = 1e-10  # rad and m: rounding of coordinates of ten metres, times what two steps add
estimators = pytest.mark.parametrize("estimate", [adjust_plucker, adjust_alshawa], ids=["lichtenstein", "alshawa"])


def run(estimate: Any, pair: ObservedPair, start: RigidTransform | None = None) -> LineEstimate:
    return estimate(pair.target, pair.source, pair.correspondences, pair.start if start is None else start)


def noisy_pair(count: int = 8) -> ObservedPair:
    return observed_pair(generic_lines(np.random.default_rng(3), count), np.random.default_rng(4))


def exact_pair(scene: LineScene, seed: int = 1, pose: RigidTransform | None = None) -> ObservedPair:
    return observed_pair(scene, np.random.default_rng(seed), noise_m=1e-16, pose=pose)


@estimators
@pytest.mark.parametrize("name", LINE_SCENES)
def test_error_free_lines_give_the_pose(estimate: Any, name: str) -> None:
    pair = exact_pair(LINE_SCENES[name](np.random.default_rng(2)))
    result = run(estimate, pair)
    assert result.converged
    np.testing.assert_allclose(pose_error(result.pose.target_from_source, pair.pose), 0.0, atol=EXACT)


@estimators
def test_lines_without_a_difference_in_z_give_the_pose(estimate: Any) -> None:
    scene = LineScene(np.array([[0.0, 0.0, 1.0], [3.0, 1.0, 0.0], [1.0, 4.0, 2.0]]), np.eye(3)[[0, 1, 0]])
    pair = exact_pair(scene, pose=RigidTransform.from_translation([1.0, -2.0, 0.5]))
    result = run(estimate, pair)
    np.testing.assert_allclose(pose_error(result.pose.target_from_source, pair.pose), 0.0, atol=EXACT)


def test_alshawa_says_how_many_lines_are_not_projected_along_z() -> None:
    scene = LineScene(np.array([[0.0, 0.0, 1.0], [3.0, 1.0, 0.0], [1.0, 4.0, 2.0]]), np.eye(3)[[0, 1, 2]])
    result = run(adjust_alshawa, exact_pair(scene, pose=RigidTransform.from_translation([1.0, -2.0, 0.5])))
    assert result.remarks == ("2 of 3 lines extend less along Z than along X or Y: projected along that axis instead",)


@estimators
def test_moving_the_source_frame_moves_the_pose_with_it(estimate: Any) -> None:
    pair = noisy_pair()
    motion = random_motion(np.random.default_rng(5))
    there = run(estimate, pair)
    moved = estimate(pair.target, moved_lines(pair.source, motion), pair.correspondences, pair.start * motion.inv())
    expected = there.pose.target_from_source * motion.inv()
    np.testing.assert_allclose(pose_error(moved.pose.target_from_source, expected), 0.0, atol=1e-9)


def test_the_order_and_direction_of_lines_do_not_matter_to_the_dissertations_model() -> None:
    pair = noisy_pair()
    first = run(adjust_plucker, pair)
    reversed_ = lines_from_arrays(
        pair.source.anchors, -pair.source.directions, pair.source.covariances, pair.source.extents
    )
    second = adjust_plucker(pair.target, reversed_, pair.correspondences[::-1].copy(), pair.start)
    np.testing.assert_allclose(
        pose_error(second.pose.target_from_source, first.pose.target_from_source), 0.0, atol=EXACT
    )


def test_the_dissertations_pose_depends_on_the_targets_origin() -> None:
    pair = noisy_pair()
    origin = np.array([100.0, 0.0, 0.0])
    far = adjust_plucker(
        lines_about(pair.target, -origin),
        pair.source,
        pair.correspondences,
        RigidTransform.from_translation(origin) * pair.start,
    )
    back = RigidTransform.from_translation(-origin) * far.pose.target_from_source
    # 5 mm points: the two answers differ by some mm
    assert np.linalg.norm(pose_error(back, run(adjust_plucker, pair).pose.target_from_source)[3:]) > 1e-3


def test_alshawas_pose_does_not_depend_on_the_targets_origin() -> None:
    pair = noisy_pair()
    origin = np.array([100.0, 20.0, -50.0])
    far = adjust_alshawa(
        lines_about(pair.target, -origin),
        pair.source,
        pair.correspondences,
        RigidTransform.from_translation(origin) * pair.start,
    )
    back = RigidTransform.from_translation(-origin) * far.pose.target_from_source
    np.testing.assert_allclose(pose_error(back, run(adjust_alshawa, pair).pose.target_from_source), 0.0, atol=1e-9)


@pytest.mark.parametrize("phi_rad", [0.5 * np.pi, 0.5 * np.pi - 1e-4, -0.5 * np.pi])
def test_an_attitude_in_which_omega_and_kappa_are_one_gives_the_pose_as_well(phi_rad: float) -> None:
    pose = RigidTransform.from_components([1.0, 2.0, 3.0], rotation_from_angles(0.3, phi_rad, 0.4))
    pair = exact_pair(generic_lines(np.random.default_rng(3), 8), pose=pose)
    result = run(adjust_plucker, pair)
    assert result.converged
    np.testing.assert_allclose(pose_error(result.pose.target_from_source, pose), 0.0, atol=EXACT)


def test_turning_the_axes_before_a_steep_attitude_changes_no_figure() -> None:
    rng = np.random.default_rng(6)
    scene = generic_lines(rng, 8)
    steep = RigidTransform.from_components([1.0, 2.0, 3.0], rotation_from_angles(0.3, 0.5 * np.pi - 0.05, 0.4))
    pair = observed_pair(scene, rng, pose=steep)
    turn = RigidTransform.from_rotation(Rotation.from_euler("y", -0.6))
    there = run(adjust_plucker, pair)
    level = adjust_plucker(moved_lines(pair.target, turn), pair.source, pair.correspondences, turn * pair.start)
    back = turn.inv() * level.pose.target_from_source
    np.testing.assert_allclose(pose_error(back, there.pose.target_from_source), 0.0, atol=1e-9)
    assert level.steps[0].sigma0 == pytest.approx(there.steps[0].sigma0, rel=1e-9)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(level.claimed.covariance), np.linalg.eigvalsh(there.claimed.covariance), rtol=1e-6
    )


def test_derivatives_by_omega_phi_kappa_and_t_agree_with_numerical_ones() -> None:
    rng = np.random.default_rng(8)
    rows = plucker_coordinates(exact_pair(generic_lines(rng, 4)).source)
    angles = np.array([0.3, -0.7, 1.9])
    x = np.concatenate([angles, [2.0, -3.0, 1.0]])

    def moved(unknowns: np.ndarray) -> np.ndarray:
        pose = RigidTransform.from_components(unknowns[3:], rotation_from_angles(*unknowns[:3]))
        return (rows @ plucker_motion(pose).T).ravel()

    step = 1e-6
    numerical = np.stack([(moved(x + step * e) - moved(x - step * e)) / (2 * step) for e in np.eye(6)], axis=1)
    target = moved(x).reshape(-1, 6)
    solution = plucker_solution(target, rows, RigidTransform.from_components(x[3:], rotation_from_angles(*angles)))
    np.testing.assert_allclose(solution.design, numerical, atol=1e-8)  # central differences of metres


def test_the_dissertation_counts_six_equations_per_line() -> None:
    step = run(adjust_plucker, noisy_pair()).steps[0]
    assert (step.equations, step.unknowns, step.redundancy) == (48, 6, 42)
    assert step.last_step < 1e-13


def test_alshawa_counts_two_equations_per_line_and_step() -> None:
    steps = run(adjust_alshawa, noisy_pair()).steps
    assert [(step.name, step.equations, step.unknowns) for step in steps] == [
        ("rotation", 16, 3),
        ("translation", 16, 3),
    ]


def test_a_line_that_is_5_cm_off_is_declared_an_outlier_at_1_96() -> None:
    pair = noisy_pair(24)
    result = run(adjust_plucker, one_line_shifted(pair, 5, 2, 0.05))
    assert result.declared[5]
    assert not result.declared.all()


@estimators
def test_exactly_parallel_lines_are_refused(estimate: Any) -> None:
    rng = np.random.default_rng(9)
    scene = LineScene(rng.uniform(-4.0, 4.0, (5, 3)), np.tile([0.0, 0.6, 0.8], (5, 1)))
    pair = exact_pair(scene, pose=RigidTransform.from_translation([1.0, 2.0, 3.0]))
    with pytest.raises(DegenerateGeometryError):
        run(estimate, pair, pair.pose)


@estimators
def test_a_single_line_is_refused(estimate: Any) -> None:
    pair = exact_pair(generic_lines(np.random.default_rng(3), 3))
    with pytest.raises(TooFewCorrespondencesError):
        estimate(pair.target, pair.source, pair.correspondences[:1], pair.start)


@estimators
def test_the_answer_follows_small_errors_of_lines_as_its_covariance_says(estimate: Any) -> None:
    # unit variance in one error parameter of one line, nothing in the others: the covariance is k kᵀ
    pair = exact_pair(LINE_SCENES["rooms 24"](np.random.default_rng(2)))
    step = 1e-6
    for k in (0, 7, 23):
        for component in range(4):
            ends = [
                run(estimate, one_line_shifted(pair, k, component, side * step)).pose.target_from_source
                for side in (1.0, -1.0)
            ]
            answer = pose_error(ends[1], ends[0]) / (2.0 * step)
            line = int(pair.correspondences[k, 0])
            covariances = np.zeros((len(pair.target), 4, 4))
            covariances[line, component, component] = 1.0
            said = estimate(
                _with(pair.target, covariances),
                _with(pair.source, np.zeros((len(pair.source), 4, 4))),
                pair.correspondences,
                pair.start,
            ).pose.covariance
            # step 1e-6 of rounding 1e-10, and the second order
            np.testing.assert_allclose(said, np.outer(answer, answer), atol=1e-4 * max(np.abs(answer).max() ** 2, 1e-3))


def test_edges_that_share_a_plane_make_a_pose_more_uncertain_than_independent_ones() -> None:
    rng = np.random.default_rng(12)
    pair = observed_rooms(plane_rooms(rng), rng)
    assert pair.planes is not None
    shared = SharedErrors(pair.planes.target.covariances, pair.planes.source.covariances)
    joint = residual_covariance(pair.target, pair.source, pair.correspondences, pair.pose, shared)
    alone = residual_covariance(pair.target, pair.source, pair.correspondences, pair.pose, NOTHING_SHARED)
    np.testing.assert_allclose(np.diag(joint), np.diag(alone), rtol=1e-6)
    assert np.abs(joint - alone).max() > 0.1 * np.diag(alone).max()
    assert np.count_nonzero(alone) <= 16 * len(pair.correspondences)


def test_a_plane_covariance_that_is_none_is_refused() -> None:
    rng = np.random.default_rng(12)
    pair = observed_rooms(plane_rooms(rng), rng)
    assert pair.planes is not None
    shared = SharedErrors(-pair.planes.target.covariances, pair.planes.source.covariances)
    with pytest.raises(InvalidInputError, match="covariance of a plane"):
        adjust_plucker(pair.target, pair.source, pair.correspondences, pair.start, shared)


def test_residual_covariance_agrees_with_scattered_residuals() -> None:
    rng = np.random.default_rng(11)
    scene = generic_lines(rng, 3)
    pair = observed_pair(scene, rng)
    covariance = residual_covariance(pair.target, pair.source, pair.correspondences, pair.pose, NOTHING_SHARED)
    observed = []
    for _ in range(400):
        target, source = (_scattered(lines, rng) for lines in (pair.target, pair.source))
        observed.append(LineLine(target, source, pair.correspondences).linearised(pair.pose).residuals.ravel())
    found = np.var(observed, axis=0)
    np.testing.assert_allclose(found, np.diag(covariance), rtol=0.3)  # 4.2 sigma of a variance from 400


def test_closeness_is_that_of_the_worst_line() -> None:
    pair = exact_pair(generic_lines(np.random.default_rng(3), 8))
    shifted = one_line_shifted(one_line_shifted(pair, 2, 0, 0.01), 2, 3, 0.03)
    found = closeness(shifted.target, shifted.source, shifted.correspondences, shifted.pose)
    assert found.max_angle_rad == pytest.approx(np.arctan(0.01), rel=1e-3)
    assert found.max_distance_m == pytest.approx(0.03, rel=1e-3)


def _with(lines: Lines, covariances: np.ndarray) -> Lines:
    return lines_from_arrays(lines.anchors, lines.directions, covariances, lines.extents, bases=lines.bases)


def _scattered(lines: Lines, rng: np.random.Generator) -> Lines:
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(lines.covariances), rng.normal(size=(len(lines), 4)))
    return lines_from_arrays(
        lines.anchors + np.einsum("nij,nj->ni", lines.bases, errors[:, 2:]),
        lines.directions + np.einsum("nij,nj->ni", lines.bases, errors[:, :2]),
        lines.covariances,
        lines.extents,
    )
