"""Filters on simulated hills with houses and trees, of which every point is known."""

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress
from algorithms.terrain.ground import FILTERS, ground_of, kappa
from algorithms.terrain.options import EVERY_FILTER, Opening
from tests.scenes.simulated_terrain import hills_with_houses

LEAST_KAPPA = {
    "opening": 0.95, "slope": 0.75, "tin": 0.95, "robust": 0.85, "hierarchical": 0.9, "dual-rank": 0.5,
    "block-min": 0.05, "quantile": 0.8, "hull": 0.1, "membrane": 0.6, "local-plane": 0.6, "spline": 0.7,
    "majority": 0.95, "mdl": 0.85,
}  # fmt: skip
"""Worse than that a filter is broken; how good they are on measured terrain is another test."""


def test_every_filter_is_offered() -> None:
    assert set(FILTERS) == set(EVERY_FILTER)


SLOW_FILTERS = {"majority", "mdl"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW_FILTERS)) for name in sorted(EVERY_FILTER)]
)
def test_a_filter_finds_the_ground_between_houses_and_trees(name: str) -> None:
    points, ground = hills_with_houses(density=1.0)
    found = ground_of(points, EVERY_FILTER[name](), 1.0, NoProgress())
    assert kappa(found.ground, ground) > LEAST_KAPPA[name]
    assert not found.low.any()


def test_a_far_origin_changes_nothing() -> None:
    points, _ = hills_with_houses(density=1.0)
    near = ground_of(points, Opening(), 1.0, NoProgress())
    far = ground_of(points + np.array([0.0, 0.0, 3000.0]), Opening(), 1.0, NoProgress())
    assert (near.ground != far.ground).mean() < 1e-3


def test_points_far_below_the_ground_are_found_and_take_no_part() -> None:
    points, ground = hills_with_houses(density=1.0)
    low = np.array([[30.0, 50.0, -20.0], [70.0, 70.0, -8.0], [70.5, 70.5, -8.2]])
    found = ground_of(np.vstack([points, low]), Opening(), 1.0, NoProgress())
    assert np.flatnonzero(found.low).tolist() == [len(points), len(points) + 1, len(points) + 2]
    assert kappa(found.ground[: len(points)], ground) > 0.95


def test_a_handful_of_points_is_no_terrain() -> None:
    with pytest.raises(InvalidInputError, match="make no terrain"):
        ground_of(np.eye(3), Opening(), 1.0, NoProgress())
