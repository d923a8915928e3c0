"""Pairs of lines that look alike are all found, and of too many the rarest are kept."""

import numpy as np
import pytest

from algorithms.matching import line_pairs
from algorithms.matching.line_pairs import look_alikes


def invariants(rng: np.random.Generator, n: int) -> np.ndarray:
    """Give invariants of made-up pairs: few angles, distances that repeat, openings, and kinds."""
    angles = rng.choice([0.0, 10.0, 20.0], size=(n, 4)) + rng.normal(scale=0.4, size=(n, 4))
    distances = rng.choice([0.0, 3.0, 40.0], size=(n, 4)) + rng.normal(scale=0.4, size=(n, 4))
    sizes = rng.choice([5.0, 8.0], size=(n, 2)) + rng.normal(scale=0.4, size=(n, 2))
    return np.hstack([angles, distances, sizes, 1e3 * rng.integers(0, 5, size=(n, 2))])


def compared_one_by_one(target: np.ndarray, source: np.ndarray) -> np.ndarray:
    return np.argwhere((np.abs(target[:, None, :] - source[None, :, :]) <= 1.0).all(axis=2))


@pytest.mark.parametrize("seed", range(5))
def test_every_pair_that_differs_by_no_more_than_the_limits_is_found_and_no_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target = invariants(rng, 400)
    nearly_alike = target[:150].copy()
    nearly_alike[:, :10] += rng.uniform(-1.05, 1.05, size=(150, 10))
    source = np.vstack([invariants(rng, 500), nearly_alike])
    found = look_alikes(target, source)
    np.testing.assert_array_equal(found, compared_one_by_one(target, source))
    assert len(found) > 20


def test_a_difference_of_just_the_limit_is_none() -> None:
    target = np.zeros((1, 12))
    source = np.vstack([np.eye(12)[4], -np.eye(12)[4], 1.001 * np.eye(12)[4], 1e3 * np.eye(12)[11]])
    np.testing.assert_array_equal(look_alikes(target, source), [[0, 0], [0, 1]])


def test_where_nothing_is_alike_nothing_is_found() -> None:
    assert look_alikes(np.zeros((3, 12)), np.full((2, 12), 5.0)).shape == (0, 2)


def test_of_too_many_the_matches_of_the_rarest_pairs_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(line_pairs, "MAX_MATCHES", 4)
    target = np.zeros((3, 12))
    target[:, 0] = [0.0, 50.0, 90.0]
    source = np.zeros((7, 12))
    source[:, 0] = [0.0, 0.0, 0.0, 0.0, 50.0, 90.0, 90.0]
    np.testing.assert_array_equal(look_alikes(target, source), [[0, 0], [1, 4], [2, 5], [2, 6]])
