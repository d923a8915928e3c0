"""Closed forms for start values: exact on exact data, and unmoved by gross errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.adjustment.hybrid.closed_forms import (
    intersections,
    relative_orientation,
    resection,
    robust_similarity,
)


def photo(points: np.ndarray, pose: Rotation, place: np.ndarray) -> np.ndarray:
    """Image points over the principal distance: the camera looks along -z, y up."""
    x, y, z = pose.inv().apply(points - place).T
    return -np.stack([x, y], axis=1) / z[:, None]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def a_pose(rng: np.random.Generator) -> tuple[Rotation, np.ndarray]:
    turn = Rotation.from_euler("ZYZ", rng.uniform([-3.0, 1.0, -3.0], [3.0, 2.0, 3.0]))
    return turn, turn.apply([0.0, 0.0, 9.0])  # the origin is before the camera


@pytest.mark.parametrize("spoiled", [0, 3])
def test_a_photo_is_resected_from_ten_points_though_three_are_wrong(rng: np.random.Generator, spoiled: int) -> None:
    for _ in range(5):
        points, (turn, place) = rng.uniform(-2.0, 2.0, (10, 3)), a_pose(rng)
        image = photo(points, turn, place)
        image[:spoiled] += rng.uniform(0.05, 0.2, (spoiled, 2))
        found = resection(image, points)
        assert found is not None
        rotation, position, _ = found
        assert position.shape == (3,)
        np.testing.assert_allclose(position, place, atol=1e-5)
        np.testing.assert_allclose(rotation, turn.as_matrix(), atol=1e-6)


def test_a_resection_that_cannot_be_refined_still_gives_one_position(rng: np.random.Generator) -> None:
    for seed in range(20):
        noisy = np.random.default_rng(seed)
        points, (turn, place) = rng.uniform(-2.0, 2.0, (5, 3)), a_pose(noisy)
        image = photo(points, turn, place) + 0.05 * noisy.normal(size=(5, 2))
        found = resection(image, points)
        assert found is None or found[1].shape == (3,)


def test_two_photos_are_oriented_to_each_other_up_to_the_scale(rng: np.random.Generator) -> None:
    points = rng.uniform(-2.0, 2.0, (20, 3))
    first, second = a_pose(rng), (Rotation.identity(), np.zeros(3))
    turn = Rotation.from_rotvec([0.1, 0.5, -0.1]) * first[0]
    second = turn, turn.apply([0.0, 0.0, 9.0])
    found = relative_orientation(photo(points, *first), photo(points, *second))
    assert found is not None
    rotation, position = found
    np.testing.assert_allclose(rotation, (first[0].inv() * second[0]).as_matrix(), atol=1e-6)
    base = first[0].inv().apply(second[1] - first[1])
    np.testing.assert_allclose(position, base / np.linalg.norm(base), atol=1e-6)


def test_a_motion_is_what_most_points_agree_on(rng: np.random.Generator) -> None:
    source = rng.uniform(-5.0, 5.0, (12, 3))
    turn, shift = Rotation.from_rotvec([0.4, -1.0, 2.0]), np.array([3.0, 4.0, 5.0])
    target = turn.apply(source) + shift
    target[:4] += rng.uniform(1.0, 2.0, (4, 3))
    scale, rotation, found = robust_similarity(source, target)
    assert scale == 1.0
    np.testing.assert_allclose(rotation, turn.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found, shift, atol=1e-9)
    _, upright, at = robust_similarity(source[:2], source[:2] + shift, upright=True)
    np.testing.assert_allclose(upright, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(at, shift)


def test_rays_meet_in_their_points_and_parallel_ones_nowhere(rng: np.random.Generator) -> None:
    points = rng.uniform(-1.0, 1.0, (3, 3))
    origins = rng.uniform(5.0, 9.0, (15, 3))
    numbers = np.repeat(np.array([4, 7, 9]), 5)
    vectors = points[np.repeat(np.arange(3), 5)] - origins
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    vectors[0] = -vectors[0]  # one ray goes the wrong way
    found, places = intersections(numbers, origins, vectors)
    assert found.tolist() == [4, 7, 9]
    np.testing.assert_allclose(places, points, atol=1e-9)
    same = np.tile(vectors[5], (2, 1))
    assert len(intersections(np.array([1, 1]), origins[:2], same)[0]) == 0


def test_of_four_points_the_fourth_decides_between_the_poses_that_fit_three(rng: np.random.Generator) -> None:
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    for _ in range(10):
        turn, place = a_pose(rng)
        found = resection(photo(square, turn, place), square)
        assert found is not None
        np.testing.assert_allclose(found[1], place, atol=1e-6)
