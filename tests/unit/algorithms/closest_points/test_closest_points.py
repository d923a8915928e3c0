"""Closed form, helical motions and iterative closest points on a bumpy surface like a pressed sheet."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.closest_points.iteration import ErrorKind, IterationLimits, IterationResult, iterated
from algorithms.closest_points.motions import best_motion, helical_motion
from algorithms.closest_points.simultaneous import CloudPairs, orient_simultaneously
from algorithms.closest_points.surface_model import SurfaceModel, stiffness
from algorithms.errors import DegenerateGeometryError, InvalidInputError, TooFewCorrespondencesError

NOISE_M = 0.002
DISPLACED = RigidTransform.from_components([0.05, -0.04, 0.06], Rotation.from_rotvec([0.05, 0.04, -0.06]))


def sheet(count: int, rng: np.random.Generator, half: float) -> tuple[np.ndarray, np.ndarray]:
    x, y = rng.uniform(-half, half, (2, count))
    z = 0.3 * np.sin(1.3 * x) * np.cos(0.9 * y) + 0.025 * x * y
    by_x = 0.39 * np.cos(1.3 * x) * np.cos(0.9 * y) + 0.025 * y
    by_y = -0.27 * np.sin(1.3 * x) * np.sin(0.9 * y) + 0.025 * x
    normals = np.stack([-by_x, -by_y, np.ones(count)], axis=1)
    return np.stack([x, y, z], axis=1), normals / np.linalg.norm(normals, axis=1, keepdims=True)


@cache
def model() -> SurfaceModel:
    return SurfaceModel.of(*sheet(60_000, np.random.default_rng(1), 2.0))


@cache
def result_of(kind: ErrorKind) -> IterationResult:
    rng = np.random.default_rng(2)
    points, normals = sheet(1500, rng, 1.5)
    measured = DISPLACED.apply(points + rng.normal(0.0, NOISE_M, points.shape))
    limits = IterationLimits(1.0, max_iterations=60, least_step_m=1e-7, robust=False)
    return iterated(model(), measured, normals, RigidTransform.identity(), kind, limits)


def test_the_closed_form_is_exact_without_noise() -> None:
    source = np.random.default_rng(3).normal(size=(5, 3))
    motion = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([1.0, -2.0, 0.5]))
    found = best_motion(motion.apply(source), source, np.ones(5))
    np.testing.assert_allclose(found.as_matrix(), motion.as_matrix(), atol=1e-12)


def test_a_helical_motion_keeps_its_axis_and_moves_along_it() -> None:
    turn, point, pitch = np.array([0.0, 0.0, 0.2]), np.array([3.0, 1.0, 0.0]), 0.5
    shift = pitch * turn - np.cross(turn, point)
    moved = helical_motion(turn, shift).apply(point)
    np.testing.assert_allclose(moved - point, [0.0, 0.0, pitch * np.arctan(0.2)], atol=1e-12)


def test_a_field_without_turn_is_a_translation() -> None:
    np.testing.assert_allclose(helical_motion(np.zeros(3), np.ones(3)).as_matrix()[:3, :3], np.eye(3))


def test_a_helical_motion_is_the_velocity_to_first_order() -> None:
    turn, shift, x = np.array([1e-5, -2e-5, 3e-5]), np.array([1e-5, 4e-5, -2e-5]), np.array([1.0, -2.0, 0.5])
    velocity = shift + np.cross(turn, x)
    np.testing.assert_allclose(helical_motion(turn, shift).apply(x) - x, velocity, atol=1e-8)


def test_approximants_are_planes_on_the_surface_and_points_far_away() -> None:
    radii = np.array([[2.0, 1e6], [2.0, 1e6]])
    found = stiffness(np.array([0.0, 1e9]), radii)
    np.testing.assert_allclose(found, [[0.0, 0.0], [1.0, 0.999]], atol=1e-2)


def test_curvatures_of_a_ball_are_its_radius() -> None:
    normals = np.random.default_rng(4).normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.median(SurfaceModel.of(2.5 * normals, normals).radii_m) == pytest.approx(2.5, rel=0.01)


def test_point_to_plane_is_there_in_six_steps_and_point_to_point_in_tens() -> None:
    assert result_of(ErrorKind.PLANE).converged
    assert len(result_of(ErrorKind.PLANE).steps) <= 8
    assert len(result_of(ErrorKind.POINT).steps) > 4 * len(result_of(ErrorKind.PLANE).steps)


def test_point_to_point_creeps_and_the_others_jump() -> None:
    point, plane = result_of(ErrorKind.POINT), result_of(ErrorKind.PLANE)
    assert point.linear_rate is not None
    assert plane.linear_rate is not None
    assert point.linear_rate > 0.8
    assert plane.linear_rate < 0.2


def test_approximants_come_to_the_minimum_of_point_to_plane() -> None:
    apart = result_of(ErrorKind.D2).pose * result_of(ErrorKind.PLANE).pose.inv()
    assert np.linalg.norm(apart.translation) < 1e-5
    assert apart.rotation.magnitude() < 1e-5


def test_the_pose_is_right_to_what_noise_allows() -> None:
    off = result_of(ErrorKind.PLANE).pose * DISPLACED
    assert np.linalg.norm(off.translation) < 3e-3
    assert off.rotation.magnitude() < 1e-3


def test_points_far_from_the_surface_are_refused() -> None:
    points = np.random.default_rng(5).normal(size=(50, 3)) + 100.0
    with pytest.raises(TooFewCorrespondencesError):
        iterated(model(), points, points, RigidTransform.identity(), ErrorKind.PLANE, IterationLimits(0.5))


def thirty_clouds(rng: np.random.Generator) -> tuple[list[RigidTransform], list[CloudPairs]]:
    poses = [RigidTransform.identity()] + [
        RigidTransform.from_components(rng.uniform(-20.0, 20.0, 3), Rotation.random(random_state=rng))
        for _ in range(29)
    ]
    pairs = []
    for k in range(30):
        for j in ((k + 1) % 30, (k + 7) % 30):
            world = rng.uniform(-20.0, 20.0, (12, 3))
            pairs.append(CloudPairs(k, j, poses[k].inv().apply(world), poses[j].inv().apply(world), np.ones(12)))
    return poses, pairs


def disturbed(poses: list[RigidTransform], rng: np.random.Generator) -> list[RigidTransform]:
    return [poses[0]] + [
        RigidTransform.from_components(rng.normal(0, 0.3, 3), Rotation.from_rotvec(rng.normal(0, 0.05, 3))) * pose
        for pose in poses[1:]
    ]


def test_thirty_clouds_come_to_their_places_at_once() -> None:
    rng = np.random.default_rng(6)
    poses, pairs = thirty_clouds(rng)
    found = orient_simultaneously(pairs, disturbed(poses, rng), fixed={0})
    assert found.converged
    assert len(found.steps_m) <= 10
    for pose, truth in zip(found.world_from_cloud, poses, strict=True):
        np.testing.assert_allclose(pose.as_matrix(), truth.as_matrix(), atol=1e-8)


def test_fixed_clouds_do_not_move() -> None:
    rng = np.random.default_rng(7)
    poses, pairs = thirty_clouds(rng)
    starts = disturbed(poses, rng)
    found = orient_simultaneously(pairs, starts, fixed={0, 5}, max_iterations=3)
    np.testing.assert_array_equal(found.world_from_cloud[5].as_matrix(), starts[5].as_matrix())


def test_clouds_that_nothing_holds_are_refused() -> None:
    poses, pairs = thirty_clouds(np.random.default_rng(8))
    with pytest.raises(InvalidInputError):
        orient_simultaneously(pairs, poses, fixed=())
    few = [CloudPairs(each.first, each.second, each.points[:1], each.others[:1], np.ones(1)) for each in pairs[:1]]
    with pytest.raises(DegenerateGeometryError):
        orient_simultaneously(few, poses[:2], fixed={0})
