"""Cells that grow where points are sparse, and planes that reach as far as they are seen."""

import numpy as np
import pytest
from scipy.stats import chi2

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.planes.plane_segmentation import segment_planes
from algorithms.progress import NoProgress
from algorithms.scans.layered_cells import FLATNESS, layered_cells
from algorithms.scans.scan import Scan
from algorithms.scans.surface_cells import cell_surfaces
from algorithms.scans.voxel_grid import voxel_cells

SIZE_M, STEP_RAD, NOISE_M = 0.1, np.radians(0.5), 0.002
LOW, HIGH = np.array([-2.0, -3.0, -1.5]), np.array([28.0, 3.0, 2.5])
"""A gallery along x with the instrument at the origin: its end is seen 28 m away, with points 0.25 m apart."""


def gallery(rng, high=HIGH):
    """Give what an instrument that turns by equal angles measures inside a box."""
    azimuth, elevation = np.meshgrid(np.arange(0, 2 * np.pi, STEP_RAD), np.arange(-1.2, 1.3, STEP_RAD))
    jitter = rng.uniform(0.0, STEP_RAD, (2, azimuth.size))
    a, e = azimuth.ravel() + jitter[0], elevation.ravel() + jitter[1]
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    ranges = (np.where(rays > 0.0, high, LOW) / rays).min(axis=1)
    return rays * (ranges + rng.normal(0.0, NOISE_M, len(rays)))[:, None]


def features(points):
    scan = Scan(points, np.zeros(3), name="S", sensor_m=np.zeros(3))
    return extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))


def cells_of(points):
    voxels = voxel_cells(points, SIZE_M)
    surfaces = cell_surfaces(voxels, cap=20.0, min_count=8.0, least_width_m=0.45 * SIZE_M)
    return len(voxels), *layered_cells(voxels, surfaces, largest_residual_m=2.0 * NOISE_M)


@pytest.fixture(scope="module")
def points():
    return gallery(np.random.default_rng(1))


@pytest.fixture(scope="module")
def seen(points):
    return features(points)


def test_every_point_is_in_one_cell_and_every_cell_has_the_moments_of_its_points(points):
    _, cells, surfaces = cells_of(points)
    assert len(cells.cell_of_point) == len(points)
    assert len(surfaces.normals) == len(cells)
    counts = np.bincount(cells.cell_of_point, minlength=len(cells))
    assert (counts == cells.counts).all()
    for cell in np.random.default_rng(2).integers(len(cells), size=50):
        own = points[cells.cell_of_point == cell]
        scatter = (own - own.mean(0)).T @ (own - own.mean(0))
        assert cells.moments[cell, 1:] == pytest.approx([*own.mean(0), *scatter[np.triu_indices(3)]], abs=1e-8)


def test_where_points_are_dense_the_voxels_stay():
    x, y = np.meshgrid(np.arange(0.0, 4.0, 0.02), np.arange(0.0, 4.0, 0.02))
    count, cells, _ = cells_of(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
    assert len(cells) == count
    assert not cells.spread_m.any()


def test_larger_cells_have_flat_surface_and_none_is_left_alone(points):
    _, cells, surfaces = cells_of(points)
    larger = cells.spread_m > 0.0
    assert larger.sum() > 300
    assert (surfaces.residual_std_m[larger] < FLATNESS * surfaces.width_std_m[larger]).all()
    assert (cells.neighbours[larger] >= 0).any(axis=1).all()
    # the layers hang together: larger cells touch smaller ones, and these touch them
    of_larger = cells.neighbours[larger]
    assert (~larger[of_larger] & (of_larger >= 0)).any()
    of_smaller = cells.neighbours[~larger]
    assert (larger[of_smaller] & (of_smaller >= 0)).any()


def test_a_narrow_frame_beside_a_wall_does_not_make_large_cells():
    rng = np.random.default_rng(7)
    wall = np.column_stack([rng.uniform(0.0, 2.0, 20_000), np.zeros(20_000), rng.uniform(0.0, 2.0, 20_000)])
    frame = np.column_stack([rng.uniform(2.3, 2.33, 3000), np.zeros(3000), rng.uniform(0.0, 2.0, 3000)])
    reveal = np.column_stack([np.full(3000, 2.33), rng.uniform(0.0, 0.03, 3000), rng.uniform(0.0, 2.0, 3000)])
    points = np.concatenate([wall, frame, reveal])
    _, cells, _ = cells_of(points + rng.normal(0.0, 0.0005, points.shape))
    assert not cells.spread_m[np.unique(cells.cell_of_point[len(wall) :])].any()


def test_no_cell_is_its_own_neighbour_or_has_one_twice(points):
    _, cells, _ = cells_of(points)
    for cell, row in enumerate(cells.neighbours):
        touching = row[row >= 0]
        assert len(set(touching.tolist())) == len(touching)
        assert cell not in touching


def test_a_wall_is_one_plane_from_the_instrument_to_its_far_end(seen):
    along = [k for k in range(len(seen.planes)) if seen.planes.normals[k, 1] < -0.99]
    assert len(along) == 1
    splits = seen.planes.boundary_splits
    outline = seen.planes.boundary[splits[along[0]] : splits[along[0] + 1]]
    corners = seen.planes.centroids[along[0]] + outline @ seen.planes.bases[along[0]].T
    # at the far end its points are more than two metres apart
    assert HIGH[0] - 3.0 < corners[:, 0].max() < HIGH[0] + 0.3
    assert corners[:, 0].min() == pytest.approx(LOW[0], abs=0.3)


def test_a_wall_of_which_all_points_are_far_apart_is_found(seen):
    assert np.count_nonzero(seen.planes.normals[:, 0] < -0.99) == 1
    far = int(np.argmin(seen.planes.normals[:, 0]))
    assert seen.planes.areas_m2[far] == pytest.approx(24.0, rel=0.25)


def test_the_edge_of_wall_and_ceiling_is_as_long_as_both_are_seen(seen):
    along = np.abs(seen.lines.directions[:, 0]) > 0.999
    assert seen.lines.lengths[along].max() > 15.0


def test_far_walls_a_forearm_apart_stay_two():
    step = np.array([28.0, 3.0, 2.5])
    near, far = (
        gallery(np.random.default_rng(3), step),
        gallery(np.random.default_rng(4), step + np.array([0.35, 0.0, 0.0])),
    )
    left = near[:, 1] > 0.0
    scene = features(np.concatenate([near[left], far[far[:, 1] <= 0.0]]))
    offsets = np.einsum("ij,ij->i", scene.planes.normals, scene.planes.centroids)
    ends = np.sort(offsets[scene.planes.normals[:, 0] < -0.99])
    assert ends == pytest.approx([-28.35, -28.0], abs=0.01)


def test_features_do_not_depend_on_the_order_of_the_points(points, seen):
    other = features(points[np.random.default_rng(5).permutation(len(points))])
    assert np.sort(other.planes.areas_m2) == pytest.approx(np.sort(seen.planes.areas_m2), rel=1e-6)
    assert np.sort(other.lines.lengths) == pytest.approx(np.sort(seen.lines.lengths), rel=1e-6)


@pytest.mark.slow
def test_the_covariance_of_a_plane_seen_from_near_to_far_is_honest():
    squares = []
    for seed in range(20):
        scene = features(gallery(np.random.default_rng([6, seed]))).planes
        for axis, side in ((1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0), (0, 1.0)):
            truth = np.zeros(3)
            truth[axis] = -side
            k = int(np.argmax(scene.normals @ truth))
            wall = np.where(truth < 0.0, HIGH, LOW)
            tilt = scene.bases[k].T @ (scene.normals[k] - truth)
            off = (scene.centroids[k] - wall) @ truth / (scene.normals[k] @ truth)
            error = np.array([*tilt, off])
            squares.append(error @ np.linalg.solve(scene.covariances[k], error))
    # a part of the noise is taken to remain at flat angles, which is not so here: it may promise a little too little
    assert 0.75 < np.mean(squares) / 3.0 < chi2.ppf(0.999, 3 * len(squares)) / (3 * len(squares))


def test_regions_start_where_points_are_dense():
    rng = np.random.default_rng(8)
    near = np.column_stack([rng.uniform(0.0, 3.0, 9000), np.zeros(9000), rng.uniform(0.0, 3.0, 9000)])
    # a few points on a wall that goes on behind it, a little askew: by themselves they are the flatter ones
    far = np.column_stack([rng.uniform(3.1, 9.0, 250), np.zeros(250), rng.uniform(0.0, 3.0, 250)])
    far[:, 1] = 0.05 * (far[:, 0] - 3.0)
    _, cells, surfaces = cells_of(np.concatenate([near + rng.normal(0.0, NOISE_M, near.shape) * [0, 1, 0], far]))
    assert (cells.spread_m > 0.0).any()
    regions = segment_planes(cells, surfaces, noise_std_m=NOISE_M, sensor_m=None, cap=20.0, min_cells=6)
    dense = cells.spread_m == 0.0
    first = cells.cell_of_point[:9000]
    assert (regions.cell_labels[first[dense[first]]] == 0).mean() > 0.95
    assert abs(regions.normals[0, 1]) == pytest.approx(1.0, abs=1e-5)
