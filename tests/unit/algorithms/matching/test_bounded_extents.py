"""However far a scan extends, or in whatever unit it is: nothing that is computed grows with its box."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial import cKDTree

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.matching import plane_triples_kernels, sliding_kernels
from algorithms.matching.surface_correlation import BORDER, MOST_PADDED, _fitting_cell
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import RegistrationProblem
from algorithms.registration.neighbourhood_covariance import _summed
from algorithms.scans.scan import Scan
from algorithms.scans.sensor_position_raster import NEAREST_SURFACE_M, positions_near_surface
from algorithms.scans.voxel_grid import voxel_cells_of_fitting_size
from tests.unit.algorithms.scans.test_far_points import ROOM

MEBIBYTE = 1 << 20


@pytest.mark.parametrize("width_m", [1e5, 1.0000037e5, 4.0e7, 123_456_789.1])
def test_the_size_of_voxels_fits_every_extent_however_it_is_rounded(width_m: float) -> None:
    """The smallest size that an extent allows was computed by a division whose inverse may be rounded up."""
    for width in width_m * (1.0 + 1e-7 * np.arange(40)):
        points = np.array([[-width / 2] * 3, [width / 2] * 3, [0.0] * 3])
        cells = voxel_cells_of_fitting_size(points)
        assert width / cells.size_m < 2**20


@pytest.mark.parametrize("extent_m", [1e3, 1e5, 1e7])
def test_positions_of_the_instrument_are_few_and_near_surfaces_whatever_the_extent(extent_m: float) -> None:
    points = np.random.default_rng(0).uniform(0.0, extent_m, (20_000, 3))
    tree = cKDTree(points)
    tracemalloc.start()
    positions, step = positions_near_surface(points, tree, np.random.default_rng(1))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300 * MEBIBYTE
    assert 100 < len(positions) <= 4000
    assert np.asarray(tree.query(positions)[0]).max() < NEAREST_SURFACE_M[1] + 0.5 * step


@pytest.mark.parametrize("extents_m", [(1e7, 1.0, 1.0), (1e7, 1e7, 1e7), (1e5, 1e5, 5.0), (0.1, 0.1, 0.1)])
def test_the_rasters_of_all_shifts_are_bounded_for_long_and_narrow_scans_too(
    extents_m: tuple[float, float, float],
) -> None:
    extents = np.array(extents_m)
    assert np.prod(extents / _fitting_cell(extents) + BORDER) <= MOST_PADDED


def test_neighbourhoods_of_a_scan_are_numbered_however_far_apart_they_are() -> None:
    """A product of three sides in cells is no number of 64 bits when a side is ten thousand kilometres."""
    positions = np.array([[-5e6, -5e6, -5e6], [5e6, 5e6, 5e6], [-5e6, -5e6, -5e6 + 0.1], [0.0, 0.0, 0.0]])
    design, weights, gaps = np.ones((4, 6)), np.ones(4), np.arange(4.0)
    places, sums = _summed(design, weights, weights, gaps, positions, np.tile([0.0, 0.0, 1.0], (4, 1)), 0.5)
    np.testing.assert_array_equal(places, [[-1e7] * 3, [0] * 3, [1e7] * 3])
    np.testing.assert_allclose(sums.right[:, 0], [2.0, 3.0, 1.0])


def test_offsets_of_planes_far_apart_need_no_bin_for_every_decimetre_between() -> None:
    offsets = np.array([-1e9, 5.0, 5.0, 5.0, 1e9])
    means, votes = np.empty(3), np.empty(3)
    assert plane_triples_kernels.peaks(offsets, np.ones(5), 0.1, means, votes) == 3
    assert means[0] == pytest.approx(5.0)
    assert votes[0] == pytest.approx(3.0)


def test_surfaces_are_slid_along_each_other_over_any_distance() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1e9, 1.0, 1.0], [-1e9, 2.0, 2.0]])
    normals = np.tile([1.0, 0.0, 0.0], (3, 1))
    offsets, votes = np.empty((1, 6)), np.empty((1, 6))
    settings = np.array([0.6, 1000.0, 0.4, 0.15])
    sliding_kernels.slide(
        points, normals, points, normals, np.eye(3), np.eye(3), np.zeros((1, 3)), settings, offsets, votes
    )
    assert votes[0, 0] >= 3.0
    assert abs(offsets[0, 0]) < 4e9 / sliding_kernels.MOST_BINS


@pytest.mark.slow
@pytest.mark.parametrize("metres", [1e3, 1e6])
def test_a_pair_in_another_unit_ends_with_an_answer(metres: float) -> None:
    rng = np.random.default_rng(8)
    scans = [Scan(metres * (cloud + rng.normal(size=cloud.shape) * 0.002), np.zeros(3)) for cloud in (ROOM, ROOM)]
    features = [
        extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)) for scan in scans
    ]
    result = DEFAULT_METHOD().register(RegistrationProblem(features[0], features[1]), progress=NoProgress())
    assert not result.status.in_place
    assert result.reasons
