"""Closed forms of rotations, poses, lines and line pairs against definitions and numerical differentiation."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import InvalidInputError, TooFewCorrespondencesError
from algorithms.geometry.angles import (
    GON_PER_RAD,
    angle_covariance,
    angles_from_rotation,
    phi_variance,
    rotation_from_angles,
    rotation_vector_rates,
)
from algorithms.geometry.line_motion import lines_about, motion_from_matched_lines, moved_lines
from algorithms.geometry.line_pairs_geometry import (
    LinePairs,
    line_pairs_of,
    motions_between_pairs,
    pair_geometry,
)
from algorithms.geometry.lines import Lines, bases_of, lines_from_arrays
from algorithms.geometry.plucker import (
    feet_from_origin,
    line_covariances_from_plucker,
    plucker_coordinates,
    plucker_covariances,
    plucker_jacobians,
    plucker_motion,
)
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrices, cross_matrix


def random_pose(rng: np.random.Generator, size_m: float = 10.0) -> RigidTransform:
    return RigidTransform.from_components(rng.normal(size=3) * size_m, Rotation.random(rng=rng))


def random_covariance(rng: np.random.Generator, n: int, scale: float = 1e-3) -> np.ndarray:
    factor = rng.normal(size=(n, n)) * scale
    return factor @ factor.T


def random_lines(rng: np.random.Generator, n: int) -> Lines:
    directions = rng.normal(size=(n, 3))
    covariances = np.stack([random_covariance(rng, 4) for _ in range(n)])
    extents = np.tile([-1.0, 1.0], (n, 1))
    return lines_from_arrays(rng.normal(size=(n, 3)) * 5, directions, covariances, extents)


def perturbed(pose: RigidTransform, delta: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(
        np.asarray(pose.translation) + delta[3:], Rotation.from_rotvec(delta[:3]) * pose.rotation
    )


def difference(pose: RigidTransform, reference: RigidTransform) -> np.ndarray:
    turn = (pose.rotation * reference.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(pose.translation) - np.asarray(reference.translation)])


def numerical_covariance(function, pose: RigidTransform, covariance: np.ndarray) -> np.ndarray:
    """Propagate a pose covariance through a map of poses by central differences."""
    step = 1e-5
    columns = []
    for k in range(6):
        delta = np.zeros(6)
        delta[k] = step
        plus, minus = function(perturbed(pose, delta)), function(perturbed(pose, -delta))
        centre = function(pose)
        columns.append((difference(plus, centre) - difference(minus, centre)) / (2 * step))
    jacobian = np.stack(columns, axis=1)
    return jacobian @ covariance @ jacobian.T


def test_cross_matrices_multiply_like_the_cross_product():
    rng = np.random.default_rng(1)
    u, v = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", cross_matrices(u), v), np.cross(u, v), atol=1e-15)
    np.testing.assert_allclose(cross_matrix(u[0]) @ v[0], np.cross(u[0], v[0]), atol=1e-15)


def test_angles_and_rotation_are_inverse_in_every_quadrant():
    rng = np.random.default_rng(2)
    for _ in range(200):
        rotation = Rotation.random(rng=rng)
        again = rotation_from_angles(*angles_from_rotation(rotation))
        assert (again * rotation.inv()).magnitude() < 1e-12


def test_rotation_is_the_product_of_turns_about_x_y_and_z():
    omega, phi, kappa = 0.3, -0.7, 2.5
    product = (
        Rotation.from_rotvec([omega, 0, 0]) * Rotation.from_rotvec([0, phi, 0]) * Rotation.from_rotvec([0, 0, kappa])
    )
    assert (rotation_from_angles(omega, phi, kappa) * product.inv()).magnitude() < 1e-14


def test_four_hundred_gon_are_a_full_turn():
    assert GON_PER_RAD * 2 * np.pi == pytest.approx(400.0, rel=1e-15)


def test_small_angle_changes_turn_by_w():
    angles = np.array([2.0, -0.6, 1.1])
    w = rotation_vector_rates(angles[0], angles[1])
    base = rotation_from_angles(*angles)
    for k in range(3):
        step = np.eye(3)[k] * 1e-6
        turn = (rotation_from_angles(*(angles + step)) * base.inv()).as_rotvec() / 1e-6
        np.testing.assert_allclose(turn, w[:, k], atol=1e-5)
    assert np.linalg.det(w) == pytest.approx(np.cos(angles[1]), rel=1e-12)


def test_phi_variance_is_the_middle_entry_of_the_angle_covariance():
    rng = np.random.default_rng(3)
    rotation, covariance = Rotation.random(rng=rng), random_covariance(rng, 3)
    full = angle_covariance(rotation, covariance)
    assert full is not None
    assert phi_variance(rotation, covariance) == pytest.approx(full[1, 1], rel=1e-10)


@pytest.mark.parametrize("phi", [np.pi / 2, -np.pi / 2])
def test_at_gimbal_lock_omega_and_kappa_have_no_standard_deviation(phi):
    rng = np.random.default_rng(4)
    rotation = rotation_from_angles(0.4, phi, 0.9)
    pose = PoseEstimate(RigidTransform.from_components(np.zeros(3), rotation), random_covariance(rng, 6))
    omega_std, phi_std, kappa_std = pose.omega_phi_kappa_std_rad
    assert omega_std is None
    assert kappa_std is None
    assert phi_std is not None
    assert phi_std > 0
    assert (rotation_from_angles(*pose.omega_phi_kappa_rad) * rotation.inv()).magnitude() < 1e-9


def test_inverse_pose_carries_the_propagated_covariance():
    rng = np.random.default_rng(5)
    pose, covariance = random_pose(rng), random_covariance(rng, 6)
    inverse = PoseEstimate(pose, covariance).inverse()
    expected = numerical_covariance(lambda p: p.inv(), pose, covariance)
    np.testing.assert_allclose(inverse.covariance, expected, rtol=1e-5, atol=1e-12)
    assert np.abs(difference(inverse.target_from_source, pose.inv())).max() < 1e-12


def test_pose_moved_to_full_coordinates_maps_them_and_carries_its_covariance():
    rng = np.random.default_rng(6)
    pose, covariance = random_pose(rng), random_covariance(rng, 6)
    origin_t, origin_s = np.array([4e5, 5.6e6, 200.0]), np.array([-30.0, 900.0, 12.0])
    moved = PoseEstimate(pose, covariance).moved_to_origins(origin_t, origin_s)
    x = rng.normal(size=3)
    np.testing.assert_allclose(moved.target_from_source.apply(x + origin_s), pose.apply(x) + origin_t, atol=1e-8)

    def full(p: RigidTransform) -> RigidTransform:
        return RigidTransform.from_components(np.asarray(p.translation) - p.rotation.apply(origin_s), p.rotation)

    np.testing.assert_allclose(moved.covariance, numerical_covariance(full, pose, covariance), rtol=1e-4, atol=1e-10)


def test_chained_poses_add_their_propagated_covariances():
    rng = np.random.default_rng(7)
    outer, inner = random_pose(rng), random_pose(rng)
    c_outer, c_inner = random_covariance(rng, 6), random_covariance(rng, 6)
    chained = PoseEstimate(outer, c_outer).after(PoseEstimate(inner, c_inner))
    expected = numerical_covariance(lambda p: p * inner, outer, c_outer) + numerical_covariance(
        lambda p: outer * p, inner, c_inner
    )
    np.testing.assert_allclose(chained.covariance, expected, rtol=1e-5, atol=1e-12)


def test_position_covariance_follows_the_lever_arm():
    rng = np.random.default_rng(8)
    pose, covariance = random_pose(rng), random_covariance(rng, 6)
    point = rng.normal(size=3) * 20
    jacobian = np.hstack([-cross_matrix(point - np.asarray(pose.translation)), np.eye(3)])
    estimate = PoseEstimate(pose, covariance)
    np.testing.assert_allclose(estimate.position_covariance_m2(point), jacobian @ covariance @ jacobian.T, rtol=1e-12)
    ellipsoid = estimate.error_ellipsoid(point)
    rebuilt = ellipsoid.directions * ellipsoid.semi_axes_m**2 @ ellipsoid.directions.T
    np.testing.assert_allclose(rebuilt, estimate.position_covariance_m2(point), rtol=1e-9, atol=1e-14)


def test_translation_std_is_the_position_std_of_the_source_origin():
    rng = np.random.default_rng(9)
    estimate = PoseEstimate(random_pose(rng), random_covariance(rng, 6))
    np.testing.assert_allclose(estimate.translation_std_m, estimate.position_std_m(estimate.translation_m), rtol=1e-12)


def test_a_free_shift_along_z_has_no_standard_deviation():
    rng = np.random.default_rng(10)
    free = np.array([[0.0], [0.0], [0.0], [0.0], [0.0], [1.0]])
    estimate = PoseEstimate(random_pose(rng), random_covariance(rng, 6), free)
    assert [std is None for std in estimate.translation_std_m] == [False, False, True]
    assert [std is None for std in estimate.rotation_std_rad] == [False, False, False]
    assert estimate.position_std_m(np.ones(3))[2] is None


def test_correlations_have_unit_diagonal():
    rng = np.random.default_rng(11)
    covariance = random_covariance(rng, 6)
    covariance[:, 5] = covariance[5, :] = 0.0
    correlations = PoseEstimate(random_pose(rng), covariance).correlations
    np.testing.assert_allclose(np.diag(correlations), 1.0)
    assert np.abs(correlations).max() <= 1.0 + 1e-12


def test_moved_lines_have_moved_pluecker_coordinates_and_covariances():
    rng = np.random.default_rng(12)
    lines, pose = random_lines(rng, 4), random_pose(rng)
    moved = moved_lines(lines, pose)
    h = plucker_motion(pose)
    np.testing.assert_allclose(plucker_coordinates(moved), plucker_coordinates(lines) @ h.T, atol=1e-12)
    np.testing.assert_allclose(plucker_covariances(moved), h @ plucker_covariances(lines) @ h.T, atol=1e-12)


def test_pluecker_jacobian_agrees_with_numerical_differentiation():
    rng = np.random.default_rng(13)
    lines = random_lines(rng, 3)
    jacobians = plucker_jacobians(lines)
    for k in range(4):
        delta = np.zeros(4)
        delta[k] = 1e-7
        directions = lines.directions + lines.bases @ delta[:2]
        anchors = lines.anchors + lines.bases @ delta[2:]
        changed = np.hstack([directions, np.cross(anchors, directions)])
        np.testing.assert_allclose((changed - plucker_coordinates(lines)) / 1e-7, jacobians[:, :, k], atol=1e-5)


def test_line_covariance_survives_the_way_through_pluecker_coordinates():
    rng = np.random.default_rng(14)
    lines = random_lines(rng, 3)
    back = line_covariances_from_plucker(lines, plucker_covariances(lines))
    np.testing.assert_allclose(back, lines.covariances, rtol=1e-9, atol=1e-16)


def test_foot_from_origin_lies_on_the_line_and_is_perpendicular():
    rng = np.random.default_rng(15)
    lines = random_lines(rng, 5)
    feet = feet_from_origin(plucker_coordinates(lines))
    np.testing.assert_allclose(np.einsum("ij,ij->i", feet, lines.directions), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(feet - lines.anchors, lines.directions), 0.0, atol=1e-12)


def test_lines_about_an_origin_are_shifted_back():
    lines = random_lines(np.random.default_rng(16), 3)
    origin = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(lines_about(lines, origin).anchors + origin, lines.anchors)


def random_pairs(rng: np.random.Generator, n: int) -> LinePairs:
    lines = random_lines(rng, 2 * n)
    return line_pairs_of(lines, np.arange(2 * n, dtype=np.int64).reshape(n, 2))


def test_feet_of_a_pair_span_the_common_perpendicular():
    pairs = random_pairs(np.random.default_rng(17), 20)
    geometry = pair_geometry(pairs)
    between = geometry.feet_a - geometry.feet_b
    np.testing.assert_allclose(np.einsum("ij,ij->i", between, pairs.directions_a), 0.0, atol=1e-10)
    np.testing.assert_allclose(np.einsum("ij,ij->i", between, pairs.directions_b), 0.0, atol=1e-10)
    sines = np.linalg.norm(np.cross(pairs.directions_a, pairs.directions_b), axis=1)
    np.testing.assert_allclose(geometry.distances_m, np.abs(geometry.moments_m) / sines, atol=1e-10)


def test_pair_invariants_survive_a_motion_and_reversed_directions():
    rng = np.random.default_rng(18)
    lines, pose = random_lines(rng, 2), random_pose(rng)
    reversed_lines = lines_from_arrays(
        lines.anchors, lines.directions * [[1.0], [-1.0]], lines.covariances, lines.extents
    )
    pair = np.array([[0, 1]], dtype=np.int64)
    one = pair_geometry(line_pairs_of(lines, pair))
    two = pair_geometry(line_pairs_of(moved_lines(reversed_lines, pose), pair))
    np.testing.assert_allclose(np.abs(one.cosines), np.abs(two.cosines), atol=1e-12)
    np.testing.assert_allclose(one.distances_m, two.distances_m, atol=1e-11)
    np.testing.assert_array_equal(one.chirality, two.chirality)


def test_a_mirrored_pair_has_the_other_chirality():
    pairs = random_pairs(np.random.default_rng(19), 10)
    mirror = np.array([1.0, 1.0, -1.0])
    mirrored = LinePairs(
        pairs.anchors_a * mirror, pairs.directions_a * mirror, pairs.anchors_b * mirror, pairs.directions_b * mirror
    )
    np.testing.assert_array_equal(pair_geometry(pairs).chirality, -pair_geometry(mirrored).chirality)


def test_distance_of_parallel_lines_is_measured_across_them():
    z = np.array([[0.0, 0.0, 1.0]])
    pairs = LinePairs(np.array([[0.0, 0.0, 5.0]]), z, np.array([[3.0, 4.0, -7.0]]), -z)
    np.testing.assert_allclose(pair_geometry(pairs).distances_m, [5.0], atol=1e-14)


def carried(motions, k: int, h: int, points: np.ndarray) -> np.ndarray:
    return points @ motions.rotations[k, h].T + motions.translations_m[k, h]


def test_one_of_the_eight_motions_is_the_true_one():
    rng = np.random.default_rng(20)
    lines, pose = random_lines(rng, 40), random_pose(rng)
    numbers = np.arange(40, dtype=np.int64).reshape(20, 2)
    moved = moved_lines(lines, pose)
    flipped = lines_from_arrays(
        moved.anchors, moved.directions * rng.choice([-1.0, 1.0], size=(40, 1)), moved.covariances, moved.extents
    )
    source, target = line_pairs_of(lines, numbers), line_pairs_of(flipped, numbers[:, ::-1].copy())
    motions = motions_between_pairs(target, source)
    turn_error = np.linalg.norm(motions.rotations - pose.rotation.as_matrix(), axis=(2, 3))
    shift_error = np.linalg.norm(motions.translations_m - np.asarray(pose.translation), axis=2)
    assert ((turn_error + shift_error).min(axis=1) < 1e-10).all()


def test_four_motions_of_a_skew_pair_are_proper_and_carry_line_onto_line():
    rng = np.random.default_rng(21)
    lines, pose = random_lines(rng, 2), random_pose(rng)
    pair = np.array([[0, 1]], dtype=np.int64)
    source, target = line_pairs_of(lines, pair), line_pairs_of(moved_lines(lines, pose), pair)
    motions = motions_between_pairs(target, source)
    proper = motions.proper(1e-9, 1e-9)
    assert proper.sum() == 4
    for h in np.flatnonzero(proper[0]):
        swapped = h >= 4
        on_a = carried(motions, 0, h, source.anchors_b if swapped else source.anchors_a)
        on_b = carried(motions, 0, h, source.anchors_a if swapped else source.anchors_b)
        np.testing.assert_allclose(np.cross(on_a - target.anchors_a, target.directions_a), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.cross(on_b - target.anchors_b, target.directions_b), 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("angle_rad", "distance_m", "count"), [(np.pi / 2, 0.0, 8), (1.0, 0.0, 4), (np.pi / 2, 2.0, 4), (1.0, 2.0, 4)]
)
def test_number_of_proper_motions_depends_on_the_pairs_symmetry(angle_rad, distance_m, count):
    pair = LinePairs(
        np.array([[0.0, 0.0, 0.0]]),
        np.array([[1.0, 0.0, 0.0]]),
        np.array([[0.0, 0.0, distance_m]]),
        np.array([[np.cos(angle_rad), np.sin(angle_rad), 0.0]]),
    )
    assert motions_between_pairs(pair, pair).proper(1e-9, 1e-9).sum() == count


def test_all_eight_motions_are_proper_rotations_and_distinct():
    pairs = random_pairs(np.random.default_rng(22), 1)
    motions = motions_between_pairs(pairs, pairs)
    np.testing.assert_allclose(np.linalg.det(motions.rotations), 1.0, atol=1e-12)
    flat = np.hstack([motions.rotations[0].reshape(8, 9), motions.translations_m[0]])
    apart = np.linalg.norm(flat[:, None] - flat[None, :], axis=2) + np.eye(8)
    assert apart.min() > 1e-3


def test_parallel_pairs_are_refused():
    z = np.array([[0.0, 0.0, 1.0]])
    pair = LinePairs(np.zeros((1, 3)), z, np.ones((1, 3)), z)
    with pytest.raises(InvalidInputError, match="parallel"):
        motions_between_pairs(pair, pair)


@pytest.mark.parametrize("n", [3, 8, 40])
def test_start_values_are_exact_for_error_free_lines(n):
    rng = np.random.default_rng(n)
    lines, pose = random_lines(rng, n), random_pose(rng)
    moved = moved_lines(lines, pose)
    flipped = lines_from_arrays(
        moved.anchors, moved.directions * rng.choice([-1.0, 1.0], size=(n, 1)), moved.covariances, moved.extents
    )
    assert np.abs(difference(motion_from_matched_lines(flipped, lines), pose)).max() < 1e-10


def test_start_values_of_two_lines_carry_line_onto_line():
    rng = np.random.default_rng(30)
    lines, pose = random_lines(rng, 2), random_pose(rng)
    target = moved_lines(lines, pose)
    again = moved_lines(lines, motion_from_matched_lines(target, lines))
    np.testing.assert_allclose(np.cross(again.directions, target.directions), 0.0, atol=1e-10)
    np.testing.assert_allclose(np.cross(again.anchors - target.anchors, target.directions), 0.0, atol=1e-9)


def test_start_values_of_parallel_lines_carry_line_onto_line():
    rng = np.random.default_rng(31)
    direction = np.tile([[0.2, -0.3, 0.93]], (5, 1))
    lines = lines_from_arrays(
        rng.normal(size=(5, 3)) * 3, direction, np.tile(np.eye(4) * 1e-6, (5, 1, 1)), np.tile([-1.0, 1.0], (5, 1))
    )
    target = moved_lines(lines, random_pose(rng))
    again = moved_lines(lines, motion_from_matched_lines(target, lines))
    np.testing.assert_allclose(np.cross(again.directions, target.directions), 0.0, atol=1e-10)
    np.testing.assert_allclose(np.cross(again.anchors - target.anchors, target.directions), 0.0, atol=1e-9)


def test_start_values_need_two_lines():
    line = random_lines(np.random.default_rng(32), 1)
    with pytest.raises(TooFewCorrespondencesError):
        motion_from_matched_lines(line, line)


def test_bases_of_moved_lines_stay_right_handed():
    rng = np.random.default_rng(33)
    moved = moved_lines(random_lines(rng, 6), random_pose(rng))
    frames = np.concatenate([moved.bases, moved.directions[:, :, None]], axis=2)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-12)
    assert bases_of(moved.directions).shape == moved.bases.shape
