"""The covariance of a fit whose errors are alike on each wall, and the smallest matrix not below either of two."""

import numpy as np

from algorithms.registration.neighbourhood_covariance import influence_matrix
from algorithms.registration.wall_covariance import WALL_PIECE_M, covering, wall_covariance, wall_pieces

POINTS_ON_A_WALL = 30
NOISE, ERROR_OF_WALLS = 0.5, 2.0
WALLS = 24


def walls(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give derivatives (n, 3), misfits (n,) and walls (n,) of a plane fit through steps that are wrong one by one."""
    labels = np.repeat(np.arange(WALLS), POINTS_ON_A_WALL)
    design = np.column_stack([np.ones(len(labels)), rng.uniform(-1.0, 1.0, (WALLS, 2))[labels]])
    errors = rng.normal(0.0, ERROR_OF_WALLS, WALLS)[labels] + rng.normal(0.0, NOISE, len(labels))
    return design, errors, labels


def test_errors_of_walls_are_as_large_as_the_covariance_says() -> None:
    rng = np.random.default_rng(1)
    nees = []
    for _ in range(300):
        design, errors, labels = walls(rng)
        weights = np.ones(len(labels))
        estimate, *_ = np.linalg.lstsq(design, errors, rcond=None)
        left = errors - design @ estimate
        covariance = wall_covariance(design, weights, left, labels, slopes=weights)
        nees.append(float(estimate @ np.linalg.solve(covariance, estimate)))
    # of an F distribution with 3 and 21 degrees of freedom, times 3: 3.3; the mean of 300 is known to 0.2
    assert 2.7 < np.mean(nees) < 3.9


def test_a_pooled_covariance_does_not_depend_on_the_order_of_points() -> None:
    rng = np.random.default_rng(2)
    design, errors, labels = walls(rng)
    weights = rng.uniform(0.5, 1.0, len(labels))
    order = rng.permutation(len(labels))
    one = wall_covariance(design, weights, errors, labels, slopes=weights)
    other = wall_covariance(design[order], weights[order], errors[order], labels[order], slopes=weights[order])
    np.testing.assert_allclose(one, other, rtol=1e-10)


def test_pieces_are_planes_cut_into_cubes() -> None:
    positions = np.array([[0.1, 0, 0], [0.2, 0, 0], [WALL_PIECE_M + 0.2, 0, 0], [0.3, 0, 0]])
    pieces = wall_pieces(np.array([0, 0, 0, 1], dtype=np.int32), positions)
    assert pieces[0] == pieces[1]
    assert len(set(pieces.tolist())) == 3


def test_a_covering_matrix_is_not_below_either() -> None:
    rng = np.random.default_rng(3)
    first, second = (part @ part.T + 0.1 * np.eye(4) for part in rng.normal(size=(2, 4, 4)))
    whole = covering(first, second)
    for part in (first, second):
        assert np.linalg.eigvalsh(whole - part).min() > -1e-9


def test_a_covering_matrix_of_ordered_ones_is_the_larger() -> None:
    rng = np.random.default_rng(4)
    part = rng.normal(size=(3, 3))
    small = part @ part.T + np.eye(3)
    np.testing.assert_allclose(covering(small, 2.0 * small), 2.0 * small, rtol=1e-10)
    np.testing.assert_allclose(covering(2.0 * small, small), 2.0 * small, rtol=1e-10)


def test_the_influence_is_less_where_the_surfaces_that_fix_a_direction_misfit() -> None:
    design = np.repeat(np.eye(2), 50, axis=0)
    weights, slopes = np.ones(100), np.repeat([1.0, 0.5], 50)
    matrix = influence_matrix(design, weights, slopes)
    np.testing.assert_allclose(matrix, np.diag([50.0, 25.0]))


def test_the_influence_stays_positive_where_most_misfit_badly() -> None:
    design = np.repeat(np.eye(2), 50, axis=0)
    matrix = influence_matrix(design, np.ones(100), np.repeat([1.0, -0.4], 50))
    assert np.linalg.eigvalsh(matrix).min() > 0.0


def test_covariances_of_few_pieces_are_covered_too() -> None:
    rng = np.random.default_rng(4)
    first, second = (part @ part.T * 1e-6 for part in (rng.normal(size=(27, 9)), rng.normal(size=(27, 6))))
    whole = covering(first, second)
    for part in (first, second):
        assert np.linalg.eigvalsh(whole - part).min() > -1e-18
    np.testing.assert_allclose(covering(second, first), whole, rtol=0.0, atol=1e-18)
