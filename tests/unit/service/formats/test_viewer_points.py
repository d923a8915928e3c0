"""Points for the viewer: an octree of raw blocks in one file."""

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from algorithms.arrays import Array
from algorithms.progress import NoProgress
from algorithms.scans.scan import Scan
from service.formats.writers import base, cloud_of, viewer_points
from service.formats.writers.octree_spool import OctreeShape
from service.formats.writers.viewer_points import BYTES_PER_POINT, write_viewer_points

COUNT = 6000
FLOAT32_M = 1e-5
"""Coordinates of up to 50 m from the middle of a node, in float32."""
Listed = dict[str, Any]


@pytest.fixture(autouse=True)
def small_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_points, "SHAPE", OctreeShape(most_in_leaf=300, cell_levels=3))


def a_scan(count: int = COUNT, origin_m: float = 0.0) -> Scan:
    rng = np.random.default_rng(3)
    return Scan(
        points=rng.uniform(-20.0, 20.0, (count, 3)) * [1.0, 0.7, 0.2],
        origin_m=np.full(3, origin_m),
        intensity=rng.normal(1000.0, 100.0, count).astype(np.float32),
        color=rng.integers(0, 256, (count, 3)).astype(np.uint8),
    )


def written(folder: Path, scan: Scan) -> tuple[bytes, Listed]:
    listed = write_viewer_points(folder / "blocks", cloud_of(scan), NoProgress())
    return (folder / "blocks").read_bytes(), listed


def block(data: bytes, node: list[int]) -> tuple[Array, Array]:
    """Give coordinates relative to the middle of a node, and the four bytes of each point."""
    first, count = node[4:]
    part = data[first : first + BYTES_PER_POINT * count]
    return (
        np.frombuffer(part[: 12 * count], dtype="<f4").reshape(-1, 3).astype(np.float64),
        np.frombuffer(part[12 * count :], dtype=np.uint8).reshape(-1, 4),
    )


def middle(listed: Listed, node: list[int]) -> Array:
    side = listed["side_m"] / 2.0 ** node[0]
    return np.array(listed["low_m"]) + (np.array(node[1:4]) + 0.5) * side


def test_every_point_is_in_exactly_one_block(tmp_path: Path) -> None:
    scan = a_scan()
    data, listed = written(tmp_path, scan)
    found = np.concatenate([block(data, node)[0] + middle(listed, node) for node in listed["nodes"]])
    assert len(found) == listed["points"] == COUNT
    ordered = [points[np.lexsort(np.round(points.T, 3))] for points in (found, scan.points)]
    assert np.abs(ordered[0] - ordered[1]).max() < FLOAT32_M


def test_blocks_follow_each_other_without_gaps_and_the_coarsest_come_first_in_the_list(tmp_path: Path) -> None:
    data, listed = written(tmp_path, a_scan())
    places = sorted((node[4], node[5]) for node in listed["nodes"])
    ends = np.cumsum([BYTES_PER_POINT * count for _, count in places])
    assert [first for first, _ in places] == [0, *ends[:-1].tolist()]
    assert ends[-1] == len(data)
    levels = [node[0] for node in listed["nodes"]]
    assert levels == sorted(levels)
    assert levels[0] == 0 < levels[-1]


def test_points_lie_within_their_node(tmp_path: Path) -> None:
    data, listed = written(tmp_path, a_scan())
    for node in listed["nodes"]:
        half = 0.5 * listed["side_m"] / 2.0 ** node[0]
        assert np.abs(block(data, node)[0]).max() <= half + FLOAT32_M


def test_the_root_alone_shows_the_whole_extent(tmp_path: Path) -> None:
    data, listed = written(tmp_path, a_scan())
    root = block(data, listed["nodes"][0])[0]
    assert np.ptp(root, axis=0) == pytest.approx([40.0, 28.0, 8.0], rel=0.1)
    assert len(root) < COUNT / 4


def test_intensities_and_colours_are_those_of_the_points(tmp_path: Path) -> None:
    scan = a_scan()
    data, listed = written(tmp_path, scan)
    low, high = listed["intensity_limits"]
    assert scan.intensity is not None
    assert scan.color is not None
    for node in listed["nodes"]:
        xyz, channels = block(data, node)
        for point, channel in zip((xyz + middle(listed, node))[:20], channels[:20], strict=True):
            number = int(np.argmin(np.abs(scan.points - point).sum(axis=1)))
            share = np.clip((scan.intensity[number] - low) / (high - low), 0.0, 1.0)
            assert channel[0] == pytest.approx(255.0 * share, abs=0.51)
            assert channel[1:].tolist() == scan.color[number].tolist()


def test_single_reflectors_do_not_darken_all_else(tmp_path: Path) -> None:
    scan = a_scan()
    assert scan.intensity is not None
    scan.intensity[0] = 1e9
    assert written(tmp_path, scan)[1]["intensity_limits"][1] < 1500.0


def test_the_same_scan_gives_the_same_bytes(tmp_path: Path) -> None:
    assert written(tmp_path, a_scan()) == written(tmp_path, a_scan())


def test_a_far_origin_changes_the_place_of_the_root_only(tmp_path: Path) -> None:
    near, far = written(tmp_path, a_scan()), written(tmp_path, a_scan(origin_m=500_000.0))
    assert near[1]["nodes"] == far[1]["nodes"]
    for node in near[1]["nodes"]:
        (xyz, channels), (others, other_channels) = block(near[0], node), block(far[0], node)
        assert np.abs(xyz - others).max() < FLOAT32_M
        assert (channels == other_channels).all()
    assert np.subtract(far[1]["low_m"], near[1]["low_m"]) == pytest.approx(500_000.0, abs=1e-6)


def test_a_plane_and_a_single_point_are_points_too(tmp_path: Path) -> None:
    flat = a_scan()
    flat.points[:, 2] = 0.0
    assert written(tmp_path, flat)[1]["points"] == COUNT
    assert written(tmp_path, Scan(points=np.ones((1, 3)), origin_m=np.zeros(3)))[1]["nodes"] == [[0, 0, 0, 0, 0, 1]]


def test_points_that_lie_all_in_one_place_end_in_one_leaf(tmp_path: Path) -> None:
    """No division tells them apart; the octree stops at its deepest level."""
    piled = a_scan(900)
    piled.points[:800] = 1.0
    data, listed = written(tmp_path, piled)
    assert sum(node[5] for node in listed["nodes"]) == 900
    assert len(data) == 900 * BYTES_PER_POINT


def test_memory_does_not_grow_with_the_number_of_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a thousand times the points, blocks and cells would be as many as here, and so the memory."""
    for module in (base, viewer_points):
        monkeypatch.setattr(module, "POINTS_AT_ONCE", 2000)
    monkeypatch.setattr(viewer_points, "SAMPLED", 1000)
    monkeypatch.setattr(viewer_points, "SHAPE", OctreeShape(most_in_leaf=2000, deepest=3, cell_levels=2))
    peaks = []
    for count in (8_000, 64_000):
        cloud = cloud_of(a_scan(count))
        tracemalloc.start()
        write_viewer_points(tmp_path / "blocks", cloud, NoProgress())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 2.0 * peaks[0]
