"""Mounts of cameras from edges that photos and scans show."""

from dataclasses import replace

import numpy as np
import pytest

from algorithms.calibration.edge_images import edge_gaps, near_edges
from algorithms.calibration.edge_options import EdgeCalibrationOptions
from algorithms.calibration.edge_search import OUTLIER, largest_agreement
from algorithms.calibration.natural_edges import PARAMETERS, FoundMount, mounts_from_edges
from algorithms.errors import InvalidInputError
from tests.scenes.photos.edge_rooms import EdgeRoom, edge_room

SHARP = EdgeCalibrationOptions(rounding_std_m=0.0)
PLANTED = np.array([0.0012, -0.0016, 0.0, 0.003, 0.0, -0.004])
"""2 mrad and 5 mm."""


def room_of(seed: int, error: np.ndarray = PLANTED, **options) -> EdgeRoom:
    return edge_room(np.random.default_rng(seed), error=error, **options)


def found_in(room: EdgeRoom, options: EdgeCalibrationOptions = SHARP) -> FoundMount:
    (found,) = mounts_from_edges(room.stations, room.photos, options).mounts
    return found


@pytest.mark.parametrize("seed", range(2))
def test_two_mrad_and_five_mm_are_found_among_many_wrong_edges(seed: int) -> None:
    found = found_in(room_of(seed, clutter=400, beside=2))
    assert found.wrong
    assert np.abs(found.error - PLANTED).max() < 0.001
    assert (np.abs(found.error - PLANTED) < 4.0 * found.stds).all()
    assert found.median_after_px < 0.2 < found.median_before_px


def test_a_right_mount_is_left_alone() -> None:
    found = found_in(room_of(3, np.zeros(6)))
    assert not found.wrong
    assert found.determined.all()
    assert (found.detectable[:3] < 0.002).all()
    assert (found.detectable[3:] < 0.005).all()


@pytest.mark.slow
def test_mounts_are_as_certain_as_they_say() -> None:
    squares, rng = [], np.random.default_rng(5)
    for seed in range(25):
        error = np.concatenate([rng.normal(0.0, 0.001, 3), rng.normal(0.0, 0.003, 3)])
        found = found_in(room_of(seed, error, clutter=100))
        left = found.error - error
        squares.append(left @ np.linalg.solve(found.covariance, left))
    # 6 with a standard deviation of the mean of 0.7
    assert np.mean(squares) == pytest.approx(6.0, abs=2.0)


def test_no_single_line_moves_a_mount_farther_than_it_is_certain() -> None:
    room, options = room_of(8, boxes=0, clutter=20), EdgeCalibrationOptions(rounding_std_m=0.002)
    whole = mounts_from_edges(room.stations, room.photos, options)
    (found,), (station,) = whole.mounts, room.stations
    influences = []
    for line in np.unique(whole.pairs.lines):
        rest = replace(station, lines=station.lines[np.delete(np.arange(len(station.lines)), line)])
        (other,) = mounts_from_edges([rest], room.photos, options).mounts
        moved = other.error - found.error
        influences.append(float(moved @ np.linalg.solve(found.covariance, moved)))
    assert 0.02 < max(influences) < 1.02


@pytest.mark.parametrize(("seed", "rounding_std_m"), [(0, 0.003), (3, 0.01)])
def test_edges_of_frames_beside_the_right_ones_do_not_spoil_a_mount(seed: int, rounding_std_m: float) -> None:
    room = room_of(seed, beside=1, clutter=50, std_px=0.1)
    options = EdgeCalibrationOptions(rounding_std_m=rounding_std_m)
    calibration = mounts_from_edges(room.stations, room.photos, options)
    (found,) = calibration.mounts
    assert calibration.converged
    assert calibration.variance_factor == 1.0
    assert (np.abs(found.error - PLANTED) < 4.0 * found.stds).all()
    assert found.determined.all()


def test_pairs_of_one_line_agree_by_what_it_moves_all_of_them() -> None:
    rng = np.random.default_rng(4)
    by_line = rng.normal(size=(10, 4))
    covariance = by_line @ by_line.T + 1e-4 * np.eye(10)
    values = (by_line @ [1.5, -1.0, 0.5, 1.0] + 0.01 * rng.normal(size=10)).reshape(5, 2)
    wrong = np.array([False, True, False, False, True])
    values[wrong] += [[0.7, 0.7], [-0.9, -0.9]]
    np.testing.assert_array_equal(largest_agreement(values, covariance, OUTLIER), ~wrong)


def test_two_cameras_have_mounts_of_their_own() -> None:
    wrong, right = room_of(6), room_of(7, np.zeros(6))
    photos = [*wrong.photos, *(replace(photo, station=1, mount=1) for photo in right.photos)]
    first, second = mounts_from_edges([*wrong.stations, *right.stations], photos, SHARP).mounts
    assert first.wrong
    assert not second.wrong
    assert first.pair_counts[3:].sum() == second.pair_counts[:3].sum() == 0


def test_vertical_edges_alone_leave_parameters_open_that_are_named() -> None:
    room = room_of(8, np.zeros(6), std_px=4.0)
    lines = room.stations[0].lines
    upright = np.abs(lines.directions[:, 2]) > 0.9
    found = found_in(replace(room, stations=[replace(room.stations[0], lines=lines[upright])]))
    assert PARAMETERS[4] == "shift along y (down)"
    assert not found.determined[4]
    assert found.determined[[1, 2]].all()
    assert found.degrees_of_freedom < 6
    assert np.isfinite(found.statistic)


def test_photos_without_lines_tell_nothing() -> None:
    room = room_of(9)
    empty = replace(room.stations[0], lines=room.stations[0].lines[:0])
    found = found_in(replace(room, stations=[empty]))
    assert found.degrees_of_freedom == 0
    assert not found.wrong
    assert not found.determined.any()
    assert np.isinf(found.detectable).all()


def test_a_mount_farther_off_than_was_looked_is_not_called_right_by_its_own_prior() -> None:
    far = np.array([0.03, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = found_in(room_of(10, far))
    assert not found.wrong or np.abs(found.error - far).max() < 0.002


def test_no_photos_are_refused() -> None:
    with pytest.raises(InvalidInputError):
        mounts_from_edges(room_of(11).stations, [])


def test_gaps_answer_to_mounts_and_lines_as_their_derivatives_say() -> None:
    room = room_of(12, np.zeros(6))
    photo, edges = room.photos[0], room.stations[0]
    pairs = near_edges(edges, photo, 0, np.full(len(edges.lines), 15.0))
    assert len(pairs) > 10
    at = np.array([[0.001, -0.002, 0.0005, 0.002, 0.001, -0.003]])
    gaps = edge_gaps(room.stations, room.photos, pairs, at)
    for k in range(6):
        step = np.zeros((1, 6))
        step[0, k] = 1e-6
        more, less = (edge_gaps(room.stations, room.photos, pairs, at + sign * step).values for sign in (1.0, -1.0))
        # derivatives are those about the corrected pose: of second order in the correction
        np.testing.assert_allclose((more - less) / 2e-6, gaps.by_mount[:, :, k], rtol=0.02, atol=4.0)
    lines = edges.lines
    for k in range(4):
        shift = 1e-6 * lines.bases[:, :, k % 2]
        moved = [
            replace(lines, directions=lines.directions + sign * shift)
            if k < 2
            else replace(lines, anchors=lines.anchors + sign * shift)
            for sign in (1.0, -1.0)
        ]
        more, less = (edge_gaps([replace(edges, lines=each)], room.photos, pairs, at).values for each in moved)
        np.testing.assert_allclose((more - less) / 2e-6, gaps.by_line[:, :, k], rtol=1e-4, atol=1e-2)
