"""Ground plans of simulated houses are found from points alone, and trees are none."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.errors import InvalidInputError
from algorithms.roofs.building import modelled_building
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.outlines import found_outlines
from algorithms.roofs.partition import area_of
from tests.scenes.roof_kinds import KINDS, flown
from tests.scenes.simulated_terrain import hills_with_houses
from tests.unit.algorithms.roofs.test_buildings import ELL, RECTANGLE, Height, ell, hip, scanned

OPTIONS = RoofOptions(neighbourhood_m=1.2)


def overlap(one: Array, other: Array) -> float:
    """Intersection over union, on a fine raster."""
    both = np.concatenate([one, other])
    x, y = np.meshgrid(*(np.arange(both[:, k].min(), both[:, k].max(), 0.05) for k in (0, 1)))
    places = np.column_stack([x.ravel(), y.ravel()])
    first, second = inside_polygon(places, one), inside_polygon(places, other)
    return float((first & second).sum() / (first | second).sum())


@pytest.mark.parametrize(("outline", "height"), [(RECTANGLE, hip), (ELL, ell)], ids=["hip", "ell"])
def test_the_outline_of_a_house_covers_its_plan_to_nine_tenths(outline: Array, height: Height) -> None:
    points, plan = scanned(outline, height)
    rng = np.random.default_rng(5)
    tree = np.column_stack([plan.max(axis=0) + rng.uniform(1.0, 4.0, (400, 2)), rng.uniform(2.5, 9.0, 400)])
    outlines, grounds = found_outlines(np.concatenate([points, tree]), OPTIONS, 20.0)
    (found,) = outlines
    assert len(found) == len(plan)
    assert overlap(found, plan) > 0.9
    assert grounds[0] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("noise_m", [(0.02, 0.01), (0.1, 0.05)], ids=["fine", "coarse"])
@pytest.mark.parametrize("name", ["gable", "mansard", "parapet"])
def test_the_area_of_a_found_plan_is_right_whatever_the_noise(name: str, noise_m: tuple[float, float]) -> None:
    kind = KINDS[name]
    (found, *_), _ = found_outlines(flown(kind, 0, 6.0, noise_m), RoofOptions(), 20.0)
    assert abs(area_of(found)) == pytest.approx(area_of(kind.outline), rel=0.03)
    assert overlap(found, kind.outline) > 0.94


def on_ground(height: Height, seed: int = 3) -> Array:
    """Points all over a site of 120 m."""
    places = np.random.default_rng(seed).uniform(-60.0, 60.0, (20_000, 2))
    return np.column_stack([places, height(*places.T) + np.random.default_rng(seed + 1).normal(0.0, 0.02, 20_000)])


def hill(x: Array, y: Array) -> Array:
    return 9.0 * np.exp(-(x**2 + y**2) / (2.0 * 22.0**2))


def terrace(x: Array, y: Array) -> Array:
    """A yard of 20 m behind a wall of 3 m, on a slope that rises behind it."""
    slope = 0.15 * np.maximum(y, 0.0)
    return slope + np.where((np.abs(x) < 10.0) & (np.abs(y - 10.0) < 10.0), 3.0 - slope, 0.0)


@pytest.mark.parametrize("height", [hill, terrace], ids=["hill", "terrace"])
def test_terrain_that_stands_out_is_no_roof(height: Height) -> None:
    points = on_ground(height)
    with pytest.raises(InvalidInputError, match="no roof"):
        found_outlines(points, RoofOptions(neighbourhood_m=1.5), 20.0)


def test_houses_on_hills_are_found_each_by_itself() -> None:
    points, _ = hills_with_houses(density=3.0)
    outlines, _ = found_outlines(points, RoofOptions(neighbourhood_m=1.5), 20.0)
    assert sorted(abs(area_of(each)) for each in outlines) == pytest.approx([120.0, 200.0, 252.0], rel=0.05)


def test_a_plan_on_a_hill_without_a_house_is_refused() -> None:
    points = on_ground(hill)
    plan = np.array([[-8.0, -5.0], [8.0, -5.0], [8.0, 5.0], [-8.0, 5.0]])
    with pytest.raises(InvalidInputError, match="stands above its surroundings along 0 %"):
        modelled_building(points, plan, 0.0, OPTIONS)


def test_a_meadow_has_no_house() -> None:
    points, _ = scanned(RECTANGLE, lambda x, y: np.zeros_like(x + y))
    with pytest.raises(InvalidInputError, match="no roof"):
        found_outlines(points, OPTIONS, 20.0)
