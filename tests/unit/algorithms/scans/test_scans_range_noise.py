"""Noise of ranges, from the ranges of a grid alone."""

import numpy as np
import pytest

from algorithms.features.planes.plane_segmentation import noise_across
from algorithms.scans.range_noise import range_noise

STEP_RAD = np.deg2rad(0.2)


def room_ranges(rng, noise_m, rows=300, columns=200):
    """Give the ranges (rows, columns) of a scanner in a room of 6 x 4 x 3 m, with noise."""
    elevation = (np.arange(rows) - rows / 2) * STEP_RAD
    azimuth = np.arange(columns) * 2 * np.pi / columns
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    directions = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=2)
    with np.errstate(divide="ignore"):
        walls = np.array([3.0, 2.0, 1.5]) / np.abs(directions)
    return walls.min(axis=2) + rng.normal(0.0, noise_m, e.shape)


@pytest.mark.parametrize("noise_m", [0.0005, 0.002, 0.006])
def test_the_noise_of_ranges_is_found_whatever_the_walls_inclination(noise_m):
    found = range_noise(room_ranges(np.random.default_rng(1), noise_m))
    assert found == pytest.approx(noise_m, rel=0.03)  # 60 000 triplets: 0.6 %; corners and the step add a little


def test_ranges_without_noise_have_next_to_none():
    found = range_noise(room_ranges(np.random.default_rng(2), 0.0))
    assert found < 1e-4  # the step's cosine: 12 micrometres times two metres of range


def test_missing_ranges_are_left_out():
    ranges = room_ranges(np.random.default_rng(3), 0.002)
    ranges[np.random.default_rng(4).random(ranges.shape) < 0.3] = 0.0
    assert range_noise(ranges) == pytest.approx(0.002, rel=0.05)


def test_too_few_ranges_tell_nothing():
    assert range_noise(np.zeros((50, 50))) == 0.0


def test_noise_across_a_surface_shrinks_with_the_cosine_of_incidence_to_its_half():
    normal = np.array([[0.0, 0.0, 1.0]] * 3)
    positions = np.array([[0.0, 0.0, 2.0], [2.0, 0.0, 2.0], [9.0, 0.0, 1.0]])
    expected = 0.004 * np.array([1.0, np.sqrt(0.5), 0.5])
    assert noise_across(0.004, positions, normal, np.zeros(3)) == pytest.approx(expected)


def test_noise_across_is_that_of_the_ranges_where_the_instrument_is_unknown():
    assert noise_across(0.004, np.ones((2, 3)), np.eye(3)[:2], None) == pytest.approx([0.004, 0.004])
