"""Passes over points in blocks give the same bytes on one processor and on two, from memory and from disk."""

import dataclasses
import itertools

import numba
import numpy as np
import pytest

from algorithms.features.planes import plane_points_kernels
from algorithms.features.planes.plane_points import CellPlanes, label_points, part_cells, plane_frames, planes_moments
from algorithms.geometry.lines import bases_of
from algorithms.scans.point_blocks import LEAST_BLOCK, MOST_BLOCKS, blocks_of, over_blocks
from algorithms.scans.range_image_kernels import _angle
from algorithms.scans.voxel_grid import fullest_of_voxels, voxel_cells
from tests.measures.feature_stages import hall_scan, timed_features


@pytest.mark.parametrize("count", [0, 1, LEAST_BLOCK, 5 * LEAST_BLOCK + 3, 1000 * LEAST_BLOCK])
def test_blocks_cover_all_points_once(count):
    blocks = blocks_of(count)
    assert blocks[0][0] == 0
    assert blocks[-1][1] == count
    assert all(end == start for (_, end), (start, _) in itertools.pairwise(blocks))
    assert len(blocks) <= MOST_BLOCKS


def test_what_blocks_give_comes_in_their_order():
    assert over_blocks(lambda start, end: (start, end), 10 * LEAST_BLOCK) == blocks_of(10 * LEAST_BLOCK)


def everything(features):
    """List all arrays of the features of a scan."""
    parts = [
        features.lines,
        features.planes,
        features.cylinders,
        features.cylinders.axes,
        features.surface,
        features.seen,
    ]
    values = [getattr(part, field.name) for part in parts for field in dataclasses.fields(part)]
    return [value for value in values if isinstance(value, np.ndarray)]


@pytest.fixture(scope="module")
def hall():
    return hall_scan(400, 800)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["grid", "cloud"])
def test_features_are_the_same_to_the_last_bit_with_one_thread_and_with_two(hall, kind, monkeypatch):
    scan = hall if kind == "grid" else dataclasses.replace(hall, grid=None)
    found = []
    for threads in (1, 2):
        monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", threads)
        found.append(everything(timed_features(scan)[0]))
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


@pytest.mark.slow
def test_features_of_a_scan_on_disk_are_those_of_the_scan_in_memory(hall, tmp_path):
    points = np.lib.format.open_memmap(tmp_path / "points.npy", "w+", np.float64, hall.points.shape)
    points[:] = hall.points
    on_disk = timed_features(dataclasses.replace(hall, points=points))[0]
    in_memory = timed_features(hall)[0]
    assert all(np.array_equal(a, b) for a, b in zip(everything(on_disk), everything(in_memory), strict=True))


def test_voxels_of_several_tables_hold_each_point_once():
    points = np.random.default_rng(1).random((1_100_000, 3)) * [8.0, 5.0, 3.0]
    cells = voxel_cells(points, 0.25)
    cubes = np.floor((points - points.min(axis=0) + 1.5 * 0.25) / 0.25).astype(np.int64)
    found, counts = np.unique(cubes @ [10_000, 100, 1], return_counts=True)
    assert len(cells) == len(found)
    assert np.array_equal(np.sort(cells.counts), np.sort(counts))
    assert np.array_equal(np.bincount(cells.cell_of_point), cells.counts)


def test_voxels_do_not_depend_on_the_order_of_points():
    rng = np.random.default_rng(2)
    points = rng.normal(0.0, 1.0, (20_000, 3))
    order = rng.permutation(len(points))
    straight, shuffled = voxel_cells(points, 0.3), voxel_cells(points[order], 0.3)
    assert np.array_equal(straight.cell_of_point[order], shuffled.cell_of_point)
    assert shuffled.moments == pytest.approx(straight.moments, abs=1e-9)  # rounding of sums of a few hundred points


def test_the_fullest_point_of_a_voxel_is_kept_and_of_equals_the_first():
    points = np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0], [5.0, 0, 0], [5.01, 0, 0]])
    assert list(fullest_of_voxels(points, 1.0, np.array([1.0, 7.0, 7.0, 2.0, 2.0]))) == [1, 3]


def test_the_angle_of_the_range_image_is_that_of_atan2():
    y, x = np.random.default_rng(3).normal(0.0, 1.0, (2, 5000))
    y[:4], x[:4] = [0.0, 0.0, 1.0, -1.0], [1.0, -1.0, 0.0, 0.0]
    found = np.array([_angle(*pair) for pair in zip(y, x, strict=True)])
    assert found == pytest.approx(np.arctan2(y, x), abs=3e-10)


@pytest.fixture(scope="module")
def corner():
    """Points on a floor and a wall, all in one cell, and the two planes as frames with 5 mm of tolerance."""
    rng = np.random.default_rng(4)
    floor = np.column_stack([rng.random((500, 2)), rng.normal(0.0, 0.002, 500)])
    wall = np.column_stack([rng.normal(0.0, 0.002, 500), rng.random((500, 2))])
    normals = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    frames = plane_frames(normals, np.zeros((2, 3)), bases_of(normals), np.full(2, 0.005))
    cells = CellPlanes(np.array([-2], dtype=np.int32), np.array([[0, 1]], dtype=np.int32))
    points = np.concatenate([floor, wall])
    return points, np.zeros(len(points), dtype=np.int32), cells, frames


def test_points_of_two_planes_extend_both_but_shape_none(corner):
    labelled = label_points(*corner)
    points = corner[0]
    near = np.abs(points[:, [2, 0]]) <= 0.005
    assert np.array_equal(labelled.shared, near.all(axis=1))
    for plane in (0, 1):
        own = points[near[:, plane] & ~near.all(axis=1)]
        scatter = (own - own.mean(axis=0)).T @ (own - own.mean(axis=0))
        expected = [len(own), *own.mean(axis=0), *scatter[np.triu_indices(3)]]
        assert labelled.moments[plane] == pytest.approx(expected, rel=1e-9, abs=1e-9)  # rounding of 500 squares


def moments_and_parts(points, cells, candidates, frames):
    parted = part_cells(points, cells, candidates, frames)
    return planes_moments(cells, candidates, parted, frames), parted


def test_sums_of_planes_are_the_same_with_and_without_labels(corner):
    points, _, candidates, frames = corner
    moments, parted = moments_and_parts(points, voxel_cells(points, 10.0), candidates, frames)
    assert list(parted.whole) == [-1]
    assert moments == pytest.approx(label_points(*corner).moments, rel=1e-12, abs=1e-12)


def test_cells_on_their_only_plane_are_added_whole_and_others_point_by_point():
    rng = np.random.default_rng(6)
    floor = np.column_stack([rng.random((5000, 2)), rng.normal(0.3, 0.001, 5000)])
    floor[7, 2] += 0.1  # in the same voxel, but not on the plane
    cells = voxel_cells(floor, 0.25)
    normal = np.array([[0.0, 0.0, 1.0]])
    frames = plane_frames(normal, np.array([[0.4, 0.5, 0.3]]), bases_of(normal), np.full(1, 0.006))
    candidates = CellPlanes(np.zeros(len(cells), dtype=np.int32), np.empty((0, 2), dtype=np.int32))
    moments, parted = moments_and_parts(floor, cells, candidates, frames)
    torn = cells.cell_of_point[7]
    assert list(np.flatnonzero(parted.whole < 0)) == [torn]
    assert np.array_equal(parted.points, floor[cells.cell_of_point == torn])
    expected = label_points(floor, cells.cell_of_point, candidates, frames).moments
    assert expected[0, 0] == len(floor) - 1
    assert moments == pytest.approx(expected, rel=1e-9, abs=1e-9)  # rounding of 5000 squares


def test_points_without_a_plane_are_left_over():
    labels = np.array([0, 1, -1, 1, 2, -1], dtype=np.int32)
    numbers = np.array([0, -1, 1], dtype=np.int32)
    cells = np.array([3, 3, 3, -1, 4, -1], dtype=np.int32)
    assert list(plane_points_kernels.unlabelled(labels, numbers, cells, 0, 6)) == [1, 2]
