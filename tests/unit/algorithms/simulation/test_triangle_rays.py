"""Rays meet the triangle that plane geometry says, whichever library casts them."""

from importlib.util import find_spec

import numpy as np
import pytest

from algorithms.simulation.triangle_rays import ByEmbreex, ByTree, triangle_rays

CORNERS = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 2], [4, 0, 2], [0, 4, 2]], dtype=np.float64)
BOTH = np.array([[0, 1, 2], [3, 4, 5]])
DOWN = np.array([[0.0, 0.0, -1.0]], dtype=np.float32)
WITHOUT_WHEEL = pytest.mark.skipif(find_spec("embreex") is None, reason="embreex has no wheel for this machine")
KINDS = [pytest.param(ByEmbreex, marks=WITHOUT_WHEEL), ByTree]


def above(x: float, y: float, z: float) -> np.ndarray:
    return np.array([[x, y, z]], dtype=np.float32)


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_triangle_on_the_way_is_met(kind: type) -> None:
    rays = kind(CORNERS.astype(np.float32), BOTH)
    assert rays.first_met(above(1, 1, 3), DOWN).tolist() == [1]
    assert rays.first_met(above(1, 1, 1), DOWN).tolist() == [0]
    assert rays.first_met(above(3, 3, 3), DOWN).tolist() == [-1]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_nearer_or_farther_than_asked_hides_nothing(kind: type) -> None:
    rays = kind(CORNERS.astype(np.float32), BOTH)
    reaches = [(0.0, np.inf, True), (0.5, 0.9, False), (0.5, 1.1, True), (1.5, 2.5, False), (1.5, 3.5, True)]
    assert [bool(rays.any_met(above(1, 1, 3), DOWN, near, far)[0]) for near, far, _ in reaches] == [
        met for *_, met in reaches
    ]


@WITHOUT_WHEEL
def test_both_libraries_meet_the_same_triangles() -> None:
    rng = np.random.default_rng(4)
    corners = rng.uniform(-10.0, 10.0, (3000, 3)).astype(np.float32)
    triangles = np.arange(3000).reshape(-1, 3)
    ways = rng.normal(size=(20_000, 3)).astype(np.float32)
    starts = rng.uniform(-10.0, 10.0, ways.shape).astype(np.float32)
    ours, theirs = triangle_rays(corners, triangles), ByTree(corners, triangles)
    assert (ours.first_met(starts, ways) == theirs.first_met(starts, ways)).mean() > 0.9999
