"""Allowed heights of the slope filter are learned from terrain whose ground is known."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress
from algorithms.terrain.ground import ground_of, kappa
from algorithms.terrain.learned_slope import LabelledTerrain, fewest_errors, learned_slope
from algorithms.terrain.options import SlopeFilter
from tests.scenes.simulated_terrain import hills_with_houses

TOO_LEVEL = SlopeFilter(adaptive=False, slope=0.1, offset_m=0.3, radius_m=12.0)


def test_what_is_learned_from_one_terrain_tells_the_ground_of_another() -> None:
    known = LabelledTerrain(*hills_with_houses(density=1.0, seed=1))
    learned = learned_slope([known], TOO_LEVEL, 1.0, NoProgress())
    points, ground = hills_with_houses(density=1.0, seed=2)
    found, guessed = (ground_of(points, each, 1.0, NoProgress()).ground for each in (learned, TOO_LEVEL))
    assert kappa(found, ground) > 0.95 > 0.5 > kappa(guessed, ground)


def test_no_other_height_of_a_ring_makes_fewer_errors() -> None:
    rng = np.random.default_rng(0)
    ground = rng.random(300) < 0.6
    drops = np.where(ground[:, None], rng.normal(0.5, 0.5, (300, 4)), rng.normal(1.5, 1.0, (300, 4)))
    drops += 0.3 * np.arange(4)
    drops[rng.random((300, 4)) < 0.1] = -np.inf
    heights = fewest_errors(drops, ground, np.array([3.0, 3.0, 3.0, 3.0]))
    assert (np.diff(heights) >= 0.0).all()

    def wrong(tried: Array) -> int:
        return int(((drops <= tried).all(axis=1) != ground).sum())

    assert wrong(heights) < wrong(np.full(4, 3.0))
    for ring in range(4):
        low, high = heights[ring - 1] if ring else 0.0, heights[ring + 1] if ring < 3 else 10.0
        for other in np.linspace(low, high, 200):
            assert wrong(np.where(np.arange(4) == ring, other, heights)) >= wrong(heights)


def test_terrain_without_objects_teaches_nothing() -> None:
    points, _ = hills_with_houses(density=1.0)
    with pytest.raises(InvalidInputError, match="0 points of objects"):
        learned_slope([LabelledTerrain(points, np.ones(len(points), dtype=np.bool_))], TOO_LEVEL, 1.0, NoProgress())
