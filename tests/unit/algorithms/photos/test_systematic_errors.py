"""What the profile fit leaves besides noise grows where pixels repeat, near other edges and on short edges."""

import numpy as np
import pytest

from algorithms.photos.line_fit import lines_between, place_patches
from algorithms.photos.systematic_errors import END_PX, NEIGHBOUR_PX, REMAINING_PX, SAMPLING_PX, systematic_covariances


def stds(length_px, crossed_px=None, cut=False, steep=False, displaced_px=0.0):
    """Standard deviations of the place [px] and of an end against the middle [px] of an edge crossing so many rows."""
    rise = length_px / np.sqrt(2.0) if crossed_px is None else crossed_px
    end = np.array([np.sqrt(length_px**2 - rise**2), rise])
    ends = 700.3 + np.stack([np.zeros(2), end[::-1] if steep else end])[None]
    lines = lines_between(ends, 1.0, 3.5)
    covariance = systematic_covariances(lines, place_patches(lines, None), np.array([cut]), np.array([displaced_px]))[0]
    return np.sqrt(covariance[1, 1]), np.sqrt(covariance[0, 0]) * 0.5 * length_px


def test_an_edge_along_the_rows_is_displaced_by_the_whole_error_of_sampling():
    place, _ = stds(2000.0, crossed_px=0.0)
    assert place == pytest.approx(np.hypot(SAMPLING_PX, REMAINING_PX), rel=0.01)


@pytest.mark.parametrize("crossed_px", [1.0, 2.0])
def test_over_whole_pixels_the_error_of_sampling_of_the_place_cancels(crossed_px):
    place, _ = stds(2000.0, crossed_px=crossed_px)
    assert place == pytest.approx(REMAINING_PX, rel=0.05)


def test_an_edge_that_crosses_one_row_is_turned_by_the_error_of_sampling():
    _, tip = stds(2000.0, crossed_px=1.0)
    assert tip == pytest.approx(3.0 * SAMPLING_PX / np.pi, rel=0.02)


def test_a_long_slanting_edge_has_hardly_any_error_of_sampling():
    assert max(stds(2000.0)) < 1.2 * REMAINING_PX


def test_rows_and_columns_count_alike():
    assert stds(400.0, 0.7) == pytest.approx(stds(400.0, 0.7, steep=True), rel=1e-9)


@pytest.mark.parametrize("crossed_px", [0.3, 0.9, 1.7])
def test_the_formulas_are_those_of_lines_through_sampled_waves(crossed_px):
    # waves of all phases, fitted by a straight line: rms of its place and of its ends against its middle
    u = np.linspace(-0.5, 0.5, 4001)
    phases = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    waves = SAMPLING_PX * np.sin(2.0 * np.pi * crossed_px * u[:, None] + phases)
    slope, place = np.polyfit(u, waves, 1)
    expected = np.sqrt(2.0 * np.mean(place**2)), np.sqrt(2.0 * np.mean((0.5 * slope) ** 2))
    found = stds(8000.0, crossed_px=crossed_px)
    rest = np.array([REMAINING_PX, REMAINING_PX])
    assert np.array(found) == pytest.approx(np.hypot(expected, rest), rel=0.02)


def test_a_neighbour_within_the_profile_adds_its_own_error():
    alone, beside = stds(2000.0), stds(2000.0, cut=True)
    assert np.square(beside) - np.square(alone) == pytest.approx(NEIGHBOUR_PX**2, rel=1e-6)


def test_what_another_edge_within_the_blur_may_displace_adds_to_place_and_ends():
    alone, displaced = stds(2000.0), stds(2000.0, displaced_px=0.1)
    assert np.square(displaced) - np.square(alone) == pytest.approx(0.1**2, rel=1e-6)


def test_what_lies_at_an_end_moves_short_edges_most():
    short, long = stds(40.0)[0], stds(400.0)[0]
    assert short == pytest.approx(END_PX * 8.0 / 40.0, rel=0.2)
    assert long < 0.3 * short


def test_it_does_not_vanish_however_long_the_edge_is():
    assert stds(2900.0)[0] >= REMAINING_PX
