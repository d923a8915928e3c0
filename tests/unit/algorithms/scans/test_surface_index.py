"""The raster of nearest surface points, and its form to keep."""

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial import KDTree

from algorithms.features.scan_features import SurfaceSample
from algorithms.scans.surface_index import OWNER_REACH, SurfaceIndex, SurfaceOwners, surface_index, surface_owners

SPACING_M = 0.1


@pytest.fixture
def surface() -> SurfaceSample:
    """A bumpy board, of whose points every fifth has no normal."""
    rng = np.random.default_rng(5)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 3.0, SPACING_M), np.arange(0.0, 2.0, SPACING_M)))
    points = np.column_stack([x, y, 0.3 * np.sin(2.0 * x)]) + rng.normal(0.0, 0.01, (len(x), 3))
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    normals[::5] = 0.0
    return SurfaceSample(points, normals, np.full(len(x), -1, dtype=np.int32), SPACING_M)


def _index(surface: SurfaceSample, owners: SurfaceOwners | None = None) -> SurfaceIndex:
    return surface_index(surface.points, surface.normals, SPACING_M, None, owners=owners)


def test_the_owner_of_a_cell_is_the_nearest_point_with_a_normal(surface: SurfaceSample) -> None:
    index = _index(surface)
    centres = index.low_m + (np.argwhere(index.owner >= 0) + 0.5) * index.cell_m
    distances, nearest = KDTree(index.points).query(centres)
    np.testing.assert_array_equal(index.owner[index.owner >= 0], nearest)
    assert distances.max() <= OWNER_REACH * index.cell_m
    assert set(index.numbers.tolist()).isdisjoint(range(0, len(surface.points), 5))


def test_kept_owners_give_the_same_index(surface: SurfaceSample) -> None:
    kept = surface_owners(surface.points, surface.normals, SPACING_M)
    for field in fields(SurfaceIndex):
        own, other = (getattr(each, field.name) for each in (_index(surface), _index(surface, kept)))
        np.testing.assert_array_equal(own, other, err_msg=field.name)


def test_kept_owners_do_not_depend_on_the_order_of_an_index(surface: SurfaceSample) -> None:
    kept = surface_owners(surface.points, surface.normals, SPACING_M)
    numbers = np.flatnonzero(surface.normals[:, 2])
    for order in (numbers, numbers[::-1]):
        raster = kept.raster(order)
        np.testing.assert_array_equal(order[raster.ravel()[kept.cells]], kept.nearest)
        assert (raster >= 0).sum() == len(kept.cells)


def test_a_surface_without_normals_owns_nothing(surface: SurfaceSample) -> None:
    kept = surface_owners(surface.points, np.zeros_like(surface.normals), SPACING_M)
    assert len(kept.cells) == 0
    assert (kept.raster(np.empty(0, dtype=np.int64)) == -1).all()
