"""Ground plans of simulated houses are found from points alone, and trees are none."""

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.errors import InvalidInputError
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.outlines import found_outlines
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


def test_a_meadow_has_no_house() -> None:
    points, _ = scanned(RECTANGLE, lambda x, y: np.zeros_like(x + y))
    with pytest.raises(InvalidInputError, match="no roof"):
        found_outlines(points, OPTIONS, 20.0)
