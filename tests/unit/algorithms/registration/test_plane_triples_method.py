"""Triples of planes: a drawn courtyard seen by two scanners, one of them leaning."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.geometry.lines import bases_of
from algorithms.geometry.planes import Planes
from algorithms.registration.plane_agreement import LargePlanes, agreement_near
from algorithms.registration.plane_pairs_pose import pose_of_plane_pairs

POSE = RigidTransform.from_components([4.0, -3.0, 0.4], Rotation.from_rotvec([0.6, 0.1, 1.2]))


def courtyard(rng: np.random.Generator, count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, -normals * rng.uniform(4.0, 15.0, (count, 1)) + rng.normal(0.0, 1.0, (count, 3))


def planes(normals: np.ndarray, centroids: np.ndarray, std_m: float = 0.001) -> Planes:
    n = len(normals)
    square = np.array([[-3.0, -3.0], [3.0, -3.0], [3.0, 3.0], [-3.0, 3.0]])
    return Planes(
        normals, centroids, bases_of(normals), np.tile(np.diag([1e-8, 1e-8, std_m**2]), (n, 1, 1)),
        np.full(n, 0.005), np.full(n, 1000), np.full(n, 36.0), np.tile(square, (n, 1)), np.arange(n + 1) * 4,
    )  # fmt: skip


def both(rng: np.random.Generator, *, noise_m: float) -> tuple[Planes, Planes]:
    normals, centroids = courtyard(rng)
    away = centroids + noise_m * rng.normal(size=(len(normals), 1)) * normals
    source = planes(POSE.rotation.inv().apply(normals), POSE.inv().apply(away))
    return planes(normals, centroids), source


def pairs(count: int) -> np.ndarray:
    return np.stack([np.arange(count), np.arange(count)], axis=1)


def test_the_pose_is_exact_without_noise() -> None:
    found = pose_of_plane_pairs(*both(np.random.default_rng(1), noise_m=0.0), pairs(12))
    assert found is not None
    np.testing.assert_allclose(found.pose.target_from_source.as_matrix(), POSE.as_matrix(), atol=1e-9)


def test_the_covariance_holds_the_errors() -> None:
    tests = []
    for seed in range(60):
        found = pose_of_plane_pairs(*both(np.random.default_rng(seed), noise_m=0.004), pairs(12))
        assert found is not None
        shift = np.asarray(found.pose.target_from_source.translation) - np.asarray(POSE.translation)
        tests.append(shift @ np.linalg.solve(found.pose.covariance[3:, 3:], shift))
    # three degrees of freedom; the unevenness that is reckoned with makes it cautious
    assert 0.5 < np.mean(tests) < 4.5


def test_walls_without_a_floor_leave_the_height_open() -> None:
    normals, centroids = courtyard(np.random.default_rng(2))
    normals[:, 2] = 0.0
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    walls = planes(normals, centroids)
    assert pose_of_plane_pairs(walls, walls, pairs(12)) is None


def test_a_plane_that_moved_is_left_out_in_narrower_rounds() -> None:
    target, source = both(np.random.default_rng(3), noise_m=0.0)
    source.centroids[0] += 0.1 * source.normals[0]
    ours, theirs = (LargePlanes.of(each, 50, 10.0) for each in (target, source))
    start = RigidTransform.from_translation([0.01, 0.02, -0.01]) * POSE
    shift = start.apply(theirs.centre_m) - ours.centre_m
    found = agreement_near(ours, theirs, start.rotation.as_matrix(), shift, np.array([np.cos(0.02), 0.15]))
    assert found is not None
    assert len(found.estimate.pairs) == 11
    np.testing.assert_allclose(found.estimate.pose.target_from_source.as_matrix(), POSE.as_matrix(), atol=1e-6)
