"""Lines of photos tell the shift along a front that surfaces leave open, or that they do not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import PhotoEdges, ScanFeatures, SurfaceSample
from algorithms.geometry.lines import Lines, LineSource, lines_from_arrays
from algorithms.matching.open_shifts import AGREEING_M, MOST_SHIFT_M, shift_by_planes, shifted_by_lines
from tests.scenes.lines.feature_scenes import NO_CYLINDERS, NO_PLANES
from tests.scenes.lines.level_ground import ground

X = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
UNEVEN = np.array([0.4, 1.5, 2.1, 3.7, 4.3, 5.9, 6.4, 8.2])
"""Places of vertical edges that no shift lays on each other."""
TOWARDS = np.array([0.0, -1.0, 0.0])


def verticals(places: np.ndarray) -> Lines:
    n = len(places)
    anchors = np.column_stack([places, np.zeros(n), np.full(n, 2.5)])
    covariances, extents = np.tile(np.eye(4) * 1e-6, (n, 1, 1)), np.tile([-1.0, 1.0], (n, 1))
    sources = np.full(n, int(LineSource.PHOTO_EDGE), dtype=np.int32)
    return lines_from_arrays(anchors, np.tile([0.0, 0.0, 1.0], (n, 1)), covariances, extents, sources=sources)


def front(places: np.ndarray, witnesses: np.ndarray | None = None) -> ScanFeatures:
    """Vertical edges that photos show on the plane y = 0, and some that measure nothing."""
    n, others = len(places), np.empty(0) if witnesses is None else witnesses
    none, nothing = np.zeros((1, 2), dtype=np.int64), np.empty((0, 3))
    return ScanFeatures(
        lines=replace(verticals(places), photos=np.zeros(n, dtype=np.int32), photo_jacobians=np.zeros((n, 4, 6))),
        planes=NO_PLANES,
        cylinders=NO_CYLINDERS,
        surface=SurfaceSample(nothing, nothing, np.empty(0, dtype=np.int32), 0.1),
        seen=None,
        origin_m=np.zeros(3),
        sensor_m=np.array([4.0, -10.0, 1.6]),
        point_count=0,
        noise_std_m=0.002,
        photo_edges=PhotoEdges(
            *(np.array([n]) for _ in range(3)),
            none,
            np.tile(TOWARDS, (n, 1)),
            np.zeros(n, dtype=np.int32),
            verticals(others),
            np.tile(TOWARDS, (len(others), 1)),
        ),
    )


def shift_m(target: ScanFeatures, source: ScanFeatures, start_m: float) -> float | None:
    found = shifted_by_lines(target, source, RigidTransform.from_translation(start_m * X), X)
    return None if found is None else float(found.translation @ X)


@pytest.mark.parametrize("start_m", [-0.28, -0.12, 0.0, 0.2])
def test_the_shift_on_which_most_lines_agree_is_found(start_m: float) -> None:
    places = UNEVEN + np.random.default_rng(1).normal(0.0, 0.001, len(UNEVEN))
    assert shift_m(front(UNEVEN), front(places), start_m) == pytest.approx(0.0, abs=0.002)


def test_edges_that_measure_nothing_help() -> None:
    target, source = front(UNEVEN[:1], UNEVEN[1:]), front(UNEVEN[-1:], UNEVEN[:-1])
    assert shift_m(target, source, 0.15) == pytest.approx(0.0, abs=1e-9)


def test_three_lines_are_too_few() -> None:
    assert shift_m(front(UNEVEN[:3]), front(UNEVEN[:3]), 0.1) is None


def test_lines_that_fit_on_two_shifts_alike_tell_nothing() -> None:
    every = np.arange(0.0, 4.0, 0.2)
    assert shift_m(front(every), front(every), 0.05) is None


def test_a_shift_out_of_reach_is_not_replaced_by_the_best_within() -> None:
    # the frames behind the front fit on another shift, as a second plane seen from two places does
    frames = UNEVEN[:5] + 0.08
    target, source = front(UNEVEN, frames), front(UNEVEN, frames - 0.06)
    assert shift_m(target, source, MOST_SHIFT_M + 0.05) is None


def test_lines_along_the_open_direction_say_nothing() -> None:
    found = shifted_by_lines(
        front(UNEVEN), front(UNEVEN), RigidTransform.from_translation([0.0, 0.0, 0.1]), np.array([0.0, 0.0, 1.0])
    )
    assert found is None


def test_shifts_farther_apart_than_photos_are_sure_do_not_agree() -> None:
    scattered = UNEVEN + 4.0 * AGREEING_M * np.arange(len(UNEVEN))
    assert shift_m(front(UNEVEN), front(scattered), 0.0) is None


def test_scans_without_lines_tell_nothing() -> None:
    assert shift_m(front(np.empty(0)), front(UNEVEN), 0.0) is None


def test_ground_that_two_scans_see_in_different_places_is_taken_for_one_plane() -> None:
    here, there = ground([(0.0, 0.0, -1.5)], [15.0]), ground([(40.0, 10.0, -1.4)], [15.0])
    found = shift_by_planes(here, there, RigidTransform.identity(), UP)
    assert found is not None
    assert found.shift_m == pytest.approx(-0.1, abs=1e-9)
    assert 0.01 < found.std_m < 0.02
    back = shift_by_planes(there, here, RigidTransform.identity(), UP)
    assert back is not None
    assert back.shift_m == pytest.approx(0.1, abs=1e-9)


def test_a_sill_that_lies_nearly_on_another_one_moves_no_ground() -> None:
    here = ground([(0.0, 0.0, -1.5), (20.0, 0.0, 0.70)], [15.0, 1.0])
    there = ground([(40.0, 0.0, -1.4), (21.0, 0.0, 0.82)], [15.0, 1.0])
    found = shift_by_planes(here, there, RigidTransform.identity(), UP)
    assert found is not None
    assert found.shift_m == pytest.approx(-0.1, abs=1e-3)


@pytest.mark.parametrize(
    ("places_m", "sizes_m"),
    [([(40.0, 0.0, -0.9)], [15.0]), ([(40.0, 0.0, -1.4), (40.0, 20.0, -1.2)], [10.0, 9.0]), ([], [])],
    ids=["half a metre off", "two levels", "none"],
)
def test_planes_that_single_out_no_shift_give_none(places_m: list, sizes_m: list) -> None:
    here, there = ground([(0.0, 0.0, -1.5)], [15.0]), ground(places_m, sizes_m)
    assert shift_by_planes(here, there, RigidTransform.identity(), UP) is None


def test_planes_of_uncertain_direction_tell_nothing() -> None:
    here, there = (ground([(40.0 * k, 0.0, -1.5 + 0.1 * k)], [0.3], tilt_std_rad=0.02) for k in (0, 1))
    assert shift_by_planes(here, there, RigidTransform.identity(), UP) is None
