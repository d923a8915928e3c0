"""Voxels, grid blocks, tangent planes and mixed pixels."""

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.features.extraction import cut_into_cells
from algorithms.features.options import FeatureOptions
from algorithms.scans.grid_cells import grid_cells
from algorithms.scans.mixed_pixels import angular_step, mixed_pixels
from algorithms.scans.normals_kernels import smallest_axis
from algorithms.scans.scan import Scan, ScanGrid
from algorithms.scans.surface_cells import cell_surfaces, orient
from algorithms.scans.voxel_grid import voxel_cells, voxel_cells_of_fitting_size
from tests.scenes.lines.feature_scenes import rectangle


def polar_scan(range_of, rows=40, columns=90, width_rad=2 * np.pi):
    """Give points and grid of a scan whose range is a function of azimuth and elevation."""
    azimuth = np.arange(columns) * width_rad / columns
    elevation = np.linspace(0.5, -0.5, rows)
    a, e = np.meshgrid(azimuth, elevation)
    r = range_of(a, e)
    points = np.stack([r * np.cos(e) * np.cos(a), r * np.cos(e) * np.sin(a), r * np.sin(e)], axis=-1).reshape(-1, 3)
    return points, ScanGrid(np.arange(rows * columns, dtype=np.int32).reshape(rows, columns))


def test_voxel_moments_are_those_of_its_points():
    points = np.random.default_rng(1).normal(0, 1, (2000, 3)) + 500.0
    cells = voxel_cells(points, 0.5)
    cell = int(np.argmax(cells.counts))
    own = points[cells.cell_of_point == cell]
    scatter = (own - own.mean(0)).T @ (own - own.mean(0))
    expected = [len(own), *own.mean(0), *scatter[np.triu_indices(3)]]
    assert cells.moments[cell] == pytest.approx(expected, rel=1e-9, abs=1e-9)  # rounding of 500 m squared


def test_voxel_neighbours_are_the_touching_cubes():
    points = np.random.default_rng(2).random((500, 3)) * 2.0
    cells = voxel_cells(points, 0.25)
    cube = np.floor((points - points.min(0) + 1.5 * 0.25) / 0.25).astype(int)
    of_cell = np.zeros((len(cells), 3), int)
    of_cell[cells.cell_of_point] = cube
    for cell in range(len(cells)):
        touching = np.flatnonzero(np.abs(of_cell - of_cell[cell]).max(axis=1) == 1)
        assert sorted(cells.neighbours[cell][cells.neighbours[cell] >= 0]) == list(touching)


@pytest.mark.parametrize(("spacing_m", "low", "high"), [(0.01, 0.08, 0.08), (0.1, 0.13, 0.25), (0.17, 0.22, 0.45)])
def test_voxel_size_follows_the_point_spacing(spacing_m, low, high):
    points = rectangle(np.random.default_rng(3), (0, 0, 0), (10, 0, 1), (0, 8, 0), int(80 / spacing_m**2), 0.005)
    assert low <= voxel_cells_of_fitting_size(points).size_m <= high


def test_a_cloud_has_the_same_voxel_size_whether_its_voxels_are_only_counted_first_or_summed_at_once(monkeypatch):
    points = rectangle(np.random.default_rng(8), (0, 0, 0), (10, 0, 1), (0, 8, 0), 2000, 0.005)
    counted_first = voxel_cells_of_fitting_size(points)
    monkeypatch.setattr("algorithms.scans.voxel_grid.POINTS_PER_TABLE", 1)
    summed = voxel_cells_of_fitting_size(points)
    assert counted_first.size_m == summed.size_m > 0.08
    np.testing.assert_array_equal(counted_first.counts, summed.counts)


def test_an_extent_of_too_many_voxels_is_refused():
    with pytest.raises(InvalidInputError, match="voxels"):
        voxel_cells(np.array([[0.0, 0.0, 0.0], [1e9, 0.0, 0.0]]), 0.1)


def test_closed_form_axis_agrees_with_the_eigenvalue_solver():
    rng = np.random.default_rng(4)
    for _ in range(50):
        basis = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix = basis @ np.diag([rng.random() * 1e-4, 0.3 + rng.random(), 2.0 + rng.random()]) @ basis.T
        values, vectors = np.linalg.eigh(matrix)
        found = smallest_axis(*matrix[np.triu_indices(3)])
        assert np.array(found[:3]) == pytest.approx(values, abs=1e-12)
        assert abs(np.array(found[3:]) @ vectors[:, 0]) == pytest.approx(1.0, abs=1e-10)


def test_normals_turn_to_the_sensor():
    points = rectangle(np.random.default_rng(5), (-2, -2, 0), (4, 0, 0), (0, 4, 0), 5000, 0.002)
    cells = voxel_cells(points, 0.2)
    below = orient(cells, cell_surfaces(cells, cap=20.0, min_count=8.0), np.array([0.0, 0.0, -3.0]))
    fitted = np.isfinite(below.residual_std_m)
    assert fitted.mean() > 0.95
    assert (below.normals[fitted, 2] < -0.9).all()


def test_a_single_scan_line_has_no_normal():
    x = np.linspace(0, 5, 3000)
    noise = np.random.default_rng(6).normal(0, 0.01, (3000, 2))
    cells = voxel_cells(np.column_stack([x, noise]), 0.2)
    surfaces = cell_surfaces(cells, cap=20.0, min_count=8.0, least_width_m=0.09)
    assert not surfaces.normals.any()


def by_columns(points, grid):
    """Give the same scan with its points in the order of the columns."""
    order = grid.index.T.ravel()
    index = np.empty_like(grid.index)
    index.T.flat = np.arange(len(points))
    return points[order], ScanGrid(index)


def test_a_grid_knows_in_which_order_its_points_come():
    points, grid = polar_scan(lambda a, e: 5.0 + 0.0 * a * e)
    thinned = np.where(np.random.default_rng(6).random(grid.index.shape) < 0.3, np.int32(-1), grid.index)
    assert not grid.is_recorded_by_columns
    assert not ScanGrid(thinned).is_recorded_by_columns
    assert by_columns(points, grid)[1].is_recorded_by_columns
    assert grid.turned().is_recorded_by_columns
    assert (grid.turned().turned().index == grid.index).all()


def test_an_empty_grid_is_recorded_by_rows():
    assert not ScanGrid(np.full((5, 7), -1, dtype=np.int32)).is_recorded_by_columns


def test_cells_of_a_grid_do_not_depend_on_the_order_in_which_it_was_recorded():
    noise = np.random.default_rng(7).normal(0.0, 0.002, (40, 90))
    points, grid = polar_scan(lambda a, e: np.where(a < 3.0, 5.0, 7.0) / np.cos(e) + noise)
    tables, noises = [], []
    for some, index in ((points, grid), by_columns(points, grid)):
        cells, surfaces, found = cut_into_cells(
            Scan(some, np.zeros(3), grid=index, sensor_m=np.zeros(3)), FeatureOptions()
        )
        linked = np.sort((cells.neighbours >= 0).sum(axis=1))
        table = np.column_stack([cells.means, np.abs(surfaces.normals), surfaces.residual_std_m])
        tables.append((table[np.lexsort(cells.means.T)], linked, cells.size_m))
        noises.append(found)
    (ours, links, size), (theirs, other_links, other_size) = tables
    assert ours == pytest.approx(theirs, abs=1e-9)
    assert (links == other_links).all()
    assert (size, noises[0]) == pytest.approx((other_size, noises[1]), rel=1e-12)


def test_grid_blocks_close_the_circle():
    points, grid = polar_scan(lambda a, _e: np.full_like(a, 5.0))
    cells = grid_cells(points, grid, np.zeros(3))
    first, last = cells.cell_of_point[grid.index[20, 0]], cells.cell_of_point[grid.index[20, -1]]
    assert last in cells.neighbours[first]


def test_grid_blocks_of_a_sector_have_two_ends():
    points, grid = polar_scan(lambda a, _e: np.full_like(a, 5.0), width_rad=1.5)
    cells = grid_cells(points, grid, np.zeros(3))
    first, last = cells.cell_of_point[grid.index[20, 0]], cells.cell_of_point[grid.index[20, -1]]
    assert last not in cells.neighbours[first]


def test_blocks_on_both_sides_of_a_depth_edge_are_not_neighbours():
    points, grid = polar_scan(lambda a, _e: np.where(a < 3.0, 4.0, 7.0))
    cells = grid_cells(points, grid, np.zeros(3))
    edge = int(np.argmax(np.arange(90) * 2 * np.pi / 90 >= 3.0))
    near, far = cells.cell_of_point[grid.index[20, edge - 1]], cells.cell_of_point[grid.index[20, edge]]
    assert far not in cells.neighbours[near]


def test_points_between_two_depths_are_mixed_pixels():
    columns = 720
    edge = 301

    def range_of(a, _):
        column = np.round(a / (2 * np.pi / columns)).astype(int)
        return np.where(column < edge, 4.0, np.where(column == edge, 5.5, 7.0))

    points, grid = polar_scan(range_of, columns=columns)
    mixed = mixed_pixels(points, grid, np.zeros(3), angular_step(points, grid, np.zeros(3)))
    expected = np.zeros_like(mixed)
    expected[:, edge] = True
    assert (mixed == expected).all()


def test_a_steep_floor_has_no_mixed_pixels():
    points, grid = polar_scan(lambda _a, e: 1.8 / np.sin(np.maximum(-e, 0.02)), columns=400, rows=200, width_rad=1.0)
    mixed = mixed_pixels(points, grid, np.zeros(3), angular_step(points, grid, np.zeros(3)))
    assert not mixed.any()
