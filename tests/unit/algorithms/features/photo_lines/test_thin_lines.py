"""Both sides of a joint or bar that is a few pixels wide are one line in the photo: its middle."""

import numpy as np
import pytest
from scipy.special import ndtr

from algorithms.features.photo_lines.thin_lines import middles_of_thin_lines
from tests.scenes.photos.edge_images import PIXEL_STD, find

TILT_RAD, SPACING_PX, JOINTS = 0.07, 26.0, 8
WIDEST_PX = 5.0


def joints(rng: np.random.Generator, width_px: float, step: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Dark joints of one width, the ground alternating by a step from one to the next; give the photo and offsets."""
    y, x = np.mgrid[0:240, 0:320].astype(float)
    across = (y - 120.0) * np.cos(TILT_RAD) - (x - 160.0) * np.sin(TILT_RAD)
    std = np.hypot(0.8, PIXEL_STD)
    values, offsets = np.full(y.shape, 130.0), SPACING_PX * (np.arange(JOINTS) - 0.5 * (JOINTS - 1)) + rng.uniform()
    for k, offset in enumerate(offsets):
        left, right = (ndtr((across - offset - side) / std) for side in (-0.5 * width_px, 0.5 * width_px))
        values += (-1.0) ** k * step * right - 35.0 * (left - right)
    return np.clip(np.rint(values + rng.normal(0.0, 3.0, y.shape)), 0, 255).astype(np.uint8), offsets


def errors_of_middles(width_px: float, step: float, seeds: range) -> tuple[np.ndarray, np.ndarray]:
    """Give the offsets of all middles from the true ones, and their standard deviations."""
    errors, stds = [], []
    for seed in seeds:
        image, offsets = joints(np.random.default_rng(seed), width_px, step)
        thin = middles_of_thin_lines(find(image), WIDEST_PX)
        middles = thin.segments[np.flatnonzero(thin.half_widths_px > 0.0)]
        assert JOINTS // 2 < len(middles) <= JOINTS
        normal = np.array([-np.sin(TILT_RAD), np.cos(TILT_RAD)])
        places = (middles.centres - [160.0, 120.0]) @ normal
        apart = places[:, None] - offsets
        errors.append(apart[np.arange(len(middles)), np.abs(apart).argmin(axis=1)])
        stds.append(np.sqrt(middles.covariances[:, 1, 1]))
    return np.concatenate(errors), np.concatenate(stds)


@pytest.mark.parametrize("width_px", [1.5, 2.5, 4.0])
def test_the_middle_is_as_certain_as_it_says_however_the_sides_displace_each_other(width_px: float) -> None:
    errors, stds = errors_of_middles(width_px, 0.0, range(3))
    assert 0.3 < np.sqrt(np.mean((errors / stds) ** 2)) < 1.15
    assert np.abs(errors).max() < 0.08


def test_sides_of_unequal_contrast_make_the_middle_less_certain() -> None:
    errors, stds = errors_of_middles(2.0, 5.0, range(3))
    equal = errors_of_middles(2.0, 0.0, range(1))[1]
    assert np.sqrt(np.mean((errors / stds) ** 2)) < 1.15
    assert np.median(stds) > 1.5 * np.median(equal)


def test_the_shorter_side_is_spent_and_sides_far_apart_are_two_edges() -> None:
    image, _ = joints(np.random.default_rng(4), 3.0)
    segments = find(image)
    thin = middles_of_thin_lines(segments, WIDEST_PX)
    assert int(thin.spent.sum()) == JOINTS
    assert not (thin.spent & (thin.half_widths_px > 0.0)).any()
    np.testing.assert_allclose(2.0 * thin.half_widths_px[thin.half_widths_px > 0.0], 3.0, atol=0.3)
    wide, _ = joints(np.random.default_rng(4), 8.0)
    assert not middles_of_thin_lines(find(wide), WIDEST_PX).spent.any()
