"""The d2-tree pairs points as a search does, comes to the same minimum, and has a wider basin than tangent planes."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.closest_points.d2_tree import D2Tree
from algorithms.closest_points.iteration import ErrorKind, IterationLimits, iterated
from algorithms.closest_points.surface_model import SurfaceModel
from tests.unit.algorithms.closest_points.test_closest_points import DISPLACED, NOISE_M, model, sheet

CELL_M = 0.02


def test_points_are_paired_with_surface_that_is_hardly_farther_than_the_nearest() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(-2.3, 2.3, (1000, 3)) * [1.0, 1.0, 0.5]
    tree = D2Tree(model(), CELL_M, 1.0)
    own, feet = tree.nearest(points, 1.0)
    known, nearest = model().nearest(points, 1.0)
    assert len(np.setdiff1d(own, known)) == 0
    assert len(own) > 0.97 * len(known)
    place = {int(k): n for n, k in enumerate(known)}
    best = np.array([np.linalg.norm(points[k] - model().points[nearest[place[int(k)]]]) for k in own])
    found = np.linalg.norm(points[own] - model().points[feet], axis=1)
    # half the diagonal of a cell to its middle and back, or of a larger one by its distance
    slack = np.maximum(np.sqrt(3.0) * CELL_M, 0.45 * best)
    assert (found <= best + slack).all()


def test_cells_that_were_filled_are_not_filled_again() -> None:
    points, _ = sheet(1000, np.random.default_rng(6), 1.5)
    tree = D2Tree(model(), CELL_M, 1.0)
    first = tree.nearest(points, 1.0)
    count = tree.cell_count
    again = tree.nearest(points, 1.0)
    assert tree.cell_count == count > 0
    np.testing.assert_array_equal(first[1], again[1])


def test_it_comes_to_the_minimum_of_a_search() -> None:
    rng = np.random.default_rng(2)
    points, normals = sheet(1500, rng, 1.5)
    measured = DISPLACED.apply(points + rng.normal(0.0, NOISE_M, points.shape))
    limits = IterationLimits(1.0, max_iterations=60, least_step_m=1e-6, robust=False)
    start = RigidTransform.identity()
    searched = iterated(model(), measured, normals, start, ErrorKind.D2, limits)
    looked_up = iterated(model(), measured, normals, start, ErrorKind.D2, limits, D2Tree(model(), CELL_M, 1.0))
    difference = searched.pose.inv() * looked_up.pose
    assert np.linalg.norm(difference.translation) < 0.5 * NOISE_M
    assert difference.rotation.magnitude() < 0.5e-3
    assert looked_up.converged


@pytest.mark.slow
def test_it_comes_back_from_farther_than_point_to_plane() -> None:
    back = {kind: sum(_comes_back(kind, seed) for seed in range(16)) for kind in (ErrorKind.PLANE, ErrorKind.D2)}
    assert back[ErrorKind.D2] > back[ErrorKind.PLANE], back


def _comes_back(kind: ErrorKind, seed: int) -> bool:
    """Tell whether a bumpy ball, displaced by a good part of its size, is laid back."""
    rng = np.random.default_rng(100 + seed)
    surface, points, normals = _ball()
    turn = Rotation.from_rotvec(rng.normal(size=3) * 0.5)
    start = RigidTransform.from_components(rng.normal(size=3) * 0.7, turn)
    limits = IterationLimits(3.0, max_iterations=60, least_step_m=1e-5, robust=False)
    result = iterated(surface, points, normals, start, kind, limits)
    return bool(np.abs(result.pose.as_matrix() - np.eye(4)).max() < 0.04)


@cache
def _ball() -> tuple[SurfaceModel, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    x, y, z = directions.T
    radii = 1.0 + 0.25 * x * y + 0.2 * z**3 + 0.15 * x
    points = directions * radii[:, None]
    # gradient of |p| - r(p/|p|), by differences
    step, gradient = 1e-6, np.empty_like(points)
    for axis, unit in enumerate(np.eye(3)):
        up, down = (_level(points + sign * step * unit) for sign in (1.0, -1.0))
        gradient[:, axis] = (up - down) / (2.0 * step)
    normals = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    return SurfaceModel.of(points[400:], normals[400:]), points[:400], normals[:400]


def _level(points: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(points, axis=1)
    x, y, z = (points / lengths[:, None]).T
    return np.asarray(lengths - (1.0 + 0.25 * x * y + 0.2 * z**3 + 0.15 * x))


def test_points_beyond_the_reach_have_no_partner() -> None:
    tree = D2Tree(model(), CELL_M, 0.3)
    own, _ = tree.nearest(np.array([[0.0, 0.0, 5.0], [0.1, 0.1, 0.02]]), 0.3)
    assert own.tolist() == [1]


@pytest.mark.parametrize("far_m", [0.0, 500_000.0])
def test_far_coordinates_have_the_pairs_of_near_ones(far_m: float) -> None:
    near, normals = sheet(2000, np.random.default_rng(8), 1.0)
    points = near[:200] + 0.01
    surface = SurfaceModel.of(near + far_m, normals)
    _, feet = D2Tree(surface, CELL_M, 0.5).nearest(points + far_m, 0.5)
    _, expected = D2Tree(SurfaceModel.of(near, normals), CELL_M, 0.5).nearest(points, 0.5)
    assert (feet == expected).mean() > 0.98
