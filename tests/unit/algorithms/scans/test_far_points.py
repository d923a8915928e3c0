"""Isolated far points are left out of a scan, and what a scanner really saw far away is not."""

import numpy as np
import pytest

from algorithms.scans.far_points import find_far_points, without_far_points
from algorithms.scans.scan import Scan, ScanGrid

RNG = np.random.default_rng(3)


def room(count: int = 20_000) -> np.ndarray:
    """Walls, floor and ceiling of a room of 8 x 6 x 3 m about the origin."""
    points = RNG.uniform(-1.0, 1.0, (count, 3))
    axis = RNG.integers(3, size=count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis])
    return points * np.array([4.0, 3.0, 1.5])


ROOM = room()
STRAYS = {
    "one": np.array([[1e6, 0.0, 0.0]]),
    "a handful": np.array([[9e3, 1.0, 2.0], [-4e3, 7e3, 1.0], [5e2, 5e2, 5e2]]),
    "all around": RNG.uniform(-2e4, 2e4, (400, 3)),
    "a cluster": RNG.normal(size=(300, 3)) * 3.0 + [1.2e4, 0.0, 0.0],
    "a near cluster": RNG.normal(size=(200, 3)) * 3.0 + [900.0, 300.0, 0.0],
    "a thread": np.linspace(0.0, 1.0, 300)[:, None] * [8e3, 1e3, 0.0] + [150.0, 0.0, 0.0],
    "one place": np.tile([[5e4, 1.0, 2.0]], (80, 1)),
}


@pytest.mark.parametrize("kind", STRAYS)
def test_strays_are_found_and_nothing_else(kind: str) -> None:
    strays = STRAYS[kind]
    far = find_far_points(np.vstack([ROOM, strays]))
    np.testing.assert_array_equal(far.rows, len(ROOM) + np.arange(len(strays)))
    assert far.farthest_m == pytest.approx(np.linalg.norm(strays, axis=1).max(), rel=0.02)


def test_a_thread_of_single_points_from_the_instrument_does_not_join_what_is_far() -> None:
    thread = np.linspace(0.0, 1.0, 300)[:, None] * [1.5e4, 5e3, 0.0]
    kept = np.delete(np.vstack([ROOM, thread]), find_far_points(np.vstack([ROOM, thread])).rows, axis=0)
    assert len(kept) >= len(ROOM)
    assert np.abs(kept).max() < 300.0


@pytest.mark.parametrize("distance_m", [100.0, 400.0])
def test_a_small_far_facade_stays(distance_m: float) -> None:
    facade = np.column_stack([np.full(200, distance_m), RNG.uniform(-8, 8, 200), RNG.uniform(0, 9, 200)])
    facade[:, 0] += RNG.normal(size=200) * 0.005
    assert len(find_far_points(np.vstack([ROOM, facade]))) == 0


def test_no_point_of_strips_tunnels_and_parts_is_left_out() -> None:
    x = RNG.uniform(0.0, 3e4, 60_000)
    strip = np.column_stack([x, RNG.uniform(0, 400, 60_000), 5.0 * np.sin(x / 300.0)])
    angle, along = RNG.uniform(0, 2 * np.pi, 60_000), RNG.exponential(200.0, 60_000)
    tunnel = np.column_stack([along, 4.0 * np.cos(angle), 4.0 * np.sin(angle)])
    for points in (strip, tunnel, 0.03 * ROOM, 1000.0 * ROOM):
        assert len(find_far_points(points)) == 0


def test_what_is_left_out_is_said() -> None:
    assert find_far_points(ROOM).in_words() is None
    words = find_far_points(np.vstack([ROOM, STRAYS["a handful"]])).in_words()
    assert words is not None
    assert words.startswith("3 isolated points")
    assert "9000 m" in words


def test_a_grid_keeps_its_neighbourhoods_without_the_strays() -> None:
    rows, columns = 100, 200
    points = ROOM[: rows * columns].copy()
    points[777] = [1e6, 2e6, -3e6]
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    index[5, 5] = -1
    scan = Scan(points, np.zeros(3), grid=ScanGrid(index), intensity=np.arange(rows * columns, dtype=np.float32))
    kept, far = without_far_points(scan)
    assert far.rows.tolist() == [777]
    assert kept.grid is not None
    assert kept.intensity is not None
    seen = kept.grid.index >= 0
    assert not seen[5, 5]
    assert not seen[3, 177]
    assert seen.sum() == rows * columns - 2
    np.testing.assert_array_equal(kept.intensity[kept.grid.index[seen]], index[seen])
    np.testing.assert_array_equal(kept.points[kept.grid.index[seen]], points[index[seen]])


def test_the_local_origin_leaves_the_strays_too() -> None:
    """The middle between a room and a point a thousand kilometres away is no origin for a room."""
    strayed = np.vstack([ROOM + np.array([500_000.0, 5_300_000.0, 100.0]), [[1_500_000.0, 5_300_000.0, 100.0]]])
    origin = np.array([1_000_000.0, 5_300_000.0, 100.0])
    kept, _ = without_far_points(Scan(strayed - origin, origin, sensor_m=np.array([-500_000.0, 0.0, 0.0])))
    np.testing.assert_allclose(kept.points + kept.origin_m, strayed[:-1], atol=1e-9)
    np.testing.assert_allclose(kept.origin_m, [500_000.0, 5_300_000.0, 100.0], atol=1.0)
    assert kept.sensor_m is not None
    np.testing.assert_allclose(kept.sensor_m + kept.origin_m, [500_000.0, 5_300_000.0, 100.0], atol=1e-9)
