"""Normal distributions in cubic cells: moments, derivatives, and that a known motion is found again."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.distributions.cell_registration import (
    climbed,
    covariance_of,
    match_cells,
    starts_around,
)
from algorithms.distributions.cells import CellDistributions, cell_distributions, cell_score

RNG = np.random.default_rng(11)
FLOOR_SHARE = 0.1
Pair = tuple[CellDistributions, CellDistributions, RigidTransform, np.ndarray]


def room(count: int = 9000, seed: int = 3) -> np.ndarray:
    """Points of floor, three walls and a box, no two parts alike."""
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, count))
    kind = rng.integers(0, 5, count)
    parts = [
        np.column_stack([10 * u, 7 * v, 0 * u]),
        np.column_stack([0 * u, 7 * u, 3.2 * v]),
        np.column_stack([10 * u, 0 * u, 3.2 * v]),
        np.column_stack([10 * u, 7 - 0.1 * u * 10, 2.0 * v]),
        np.column_stack([6 + 1.5 * u, 3 + 1.0 * v, 1.1 + 0 * u]),
    ]
    return np.choose(kind[:, None], parts) + rng.normal(0.0, 0.003, (count, 3))


def test_cells_have_the_moments_of_their_points() -> None:
    points = np.array([[0.1, 0.2, 0.3], [0.4, 0.6, 0.2], [0.3, 0.1, 0.9], [0.8, 0.5, 0.4], [0.6, 0.9, 0.7]])
    found = cell_distributions(points, 4.0)
    assert found.in_first == 1
    np.testing.assert_allclose(found.means[0], points.mean(axis=0))
    values = np.linalg.eigvalsh(np.cov(points.T))
    expected = np.maximum(values, (FLOOR_SHARE * 4.0) ** 2)
    np.testing.assert_allclose(np.linalg.eigvalsh(found.covariances[0]), np.sort(expected))


def test_flat_cells_are_as_thick_as_the_least_width() -> None:
    points = np.column_stack([RNG.random((200, 2)), np.zeros(200)])
    found = cell_distributions(points, 2.0)
    assert np.linalg.eigvalsh(found.covariances).min() == pytest.approx((FLOOR_SHARE * 2.0) ** 2)


@pytest.fixture(scope="module")
def pair() -> Pair:
    target, source = cell_distributions(room(), 1.5), cell_distributions(room(seed=4), 1.5)
    pose = RigidTransform.from_components([0.15, -0.1, 0.07], Rotation.from_rotvec([0.02, -0.03, 0.05]))
    return target, source, pose, np.array([4.0, 3.0, 1.0])


def perturbed(pose: RigidTransform, pivot: np.ndarray, step: np.ndarray) -> RigidTransform:
    turn = Rotation.from_rotvec(step[:3])
    shift = pivot + turn.apply(np.asarray(pose.translation) - pivot) + step[3:]
    return RigidTransform.from_components(shift, turn * pose.rotation)


def test_the_gradient_is_that_of_differences(pair: Pair) -> None:
    target, source, pose, pivot = pair
    score = cell_score(target, source, pose, pivot)
    assert score.value > 1.0
    numeric = np.empty(6)
    for k, step in enumerate(1e-5 * np.eye(6)):
        up, down = (cell_score(target, source, perturbed(pose, pivot, s), pivot).value for s in (step, -step))
        numeric[k] = (up - down) / 2e-5
    np.testing.assert_allclose(score.gradient, numeric, rtol=1e-5, atol=1e-5)


def test_the_hessian_is_that_of_differences(pair: Pair) -> None:
    target, source, pose, pivot = pair
    hessian = cell_score(target, source, pose, pivot).hessian
    np.testing.assert_allclose(hessian, hessian.T)
    h, numeric = 2e-4, np.empty((6, 6))
    for i, a in enumerate(h * np.eye(6)):
        for j, b in enumerate(h * np.eye(6)):
            signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
            values = [cell_score(target, source, perturbed(pose, pivot, p * a + q * b), pivot).value for p, q in signs]
            numeric[i, j] = (values[0] - values[1] - values[2] + values[3]) / (4.0 * h * h)
    np.testing.assert_allclose(hessian, numeric, rtol=1e-3, atol=1e-3 * np.abs(hessian).max())


def test_scores_without_derivatives_are_the_same(pair: Pair) -> None:
    target, source, pose, pivot = pair
    plain = cell_score(target, source, pose, pivot, derivatives=False)
    assert plain.value == cell_score(target, source, pose, pivot).value
    assert not plain.gradient.any()


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.3], [0.5, -0.3, 0.2], [0.2, 0.2, -0.25]])
def test_a_tilted_scan_is_laid_back_from_a_metre_and_some_degrees_away(turn: list[float]) -> None:
    truth = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.9, 0.4, 1.2]))
    target, source = room(), truth.inv().apply(room(seed=4))
    start = RigidTransform.from_components([0.9, -0.7, 0.5], Rotation.from_rotvec(turn)) * truth
    (best, *_) = match_cells(target, source, [6.0, 3.0, 1.5, 0.75, 0.4], [start])
    error = best.pose * truth.inv()
    assert float(error.rotation.magnitude()) < 0.002
    assert float(np.linalg.norm(best.pose.apply(truth.inv().apply(np.array([5.0, 3.0, 1.0]))) - [5.0, 3.0, 1.0])) < 0.01
    assert best.converged


def test_every_step_raises_the_score() -> None:
    target, source = cell_distributions(room(), 1.5), cell_distributions(room(seed=4), 1.5)
    start = RigidTransform.from_components([0.4, 0.3, 0.2], Rotation.from_rotvec([0.05, 0.02, -0.1]))
    match = climbed(target, source, start, 4.0)
    scores = [step.score for step in match.steps] + [match.score.value]
    assert all(b >= a for a, b in pairwise(scores))
    assert np.linalg.eigvalsh(match.score.hessian).max() < 0.0


def test_the_covariance_of_a_slot_is_large_along_it() -> None:
    rng = np.random.default_rng(0)

    def slot() -> np.ndarray:
        u, v = rng.random((2, 4000))
        floor = np.column_stack([40 * u[:2000], 2 * v[:2000], np.zeros(2000)])
        wall = np.column_stack([40 * u[2000:], np.zeros(2000), 2 * v[2000:]])
        return np.vstack([floor, wall]) + rng.normal(0.0, 0.002, (4000, 3))

    target, source = cell_distributions(slot(), 1.0), cell_distributions(slot(), 1.0)
    std = np.sqrt(np.diag(covariance_of(climbed(target, source, RigidTransform.identity(), 10.0))))
    assert std[3] > 3.0 * max(std[4], std[5])


def test_starts_beside_a_start_turn_and_shift_its_middle_as_far_as_asked() -> None:
    start = RigidTransform.from_components([3.0, -2.0, 1.0], Rotation.from_rotvec([0.9, 0.4, 1.2]))
    pivot = np.array([1.0, 2.0, 3.0])
    starts = starts_around(start, pivot, 0.3, 2.0)
    assert len(starts) == 13
    moves = [each * start.inv() for each in starts]
    assert [round(float(move.rotation.magnitude()), 9) for move in moves] == [0.0] + [0.3] * 6 + [0.0] * 6
    shifts = [float(np.linalg.norm(move.apply(pivot) - pivot)) for move in moves]
    np.testing.assert_allclose(shifts, [0.0] * 7 + [2.0] * 6, atol=1e-12)
