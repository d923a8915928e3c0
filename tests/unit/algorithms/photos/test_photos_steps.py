"""Each step of the way from a photo to straight edges does what its name says."""

import cv2
import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.photos import line_detectors
from algorithms.photos.canny import (
    canny,
    direction_classes,
    edge_strength,
    hysteresis,
    noise_gain,
    smoothed,
    sobel,
    suppress_non_maxima,
    thresholds,
)
from algorithms.photos.edge_chains import edge_chains
from algorithms.photos.edge_profile import edge_function, fit_profile
from algorithms.photos.hough import HoughSpace, angle_step, peaks, vote
from algorithms.photos.images import grey_image, halved, noise_std
from algorithms.photos.line_fit import lines_between
from algorithms.photos.line_merging import merge_collinear, without_doubles
from algorithms.photos.options import EdgeOptions
from algorithms.photos.segment_growing import grow_segments
from algorithms.photos.segment_tracking import track_lines, walk_along
from tests.scenes.photos.edge_images import rectangles


def step_image(angle_rad, contrast=80.0, size=61):
    """A straight step through the middle; the gradient points along `angle_rad`."""
    y, x = np.mgrid[0:size, 0:size] - size // 2
    across = x * np.cos(angle_rad) + y * np.sin(angle_rad)
    return np.clip(np.rint(100.0 + contrast * np.clip(across + 0.5, 0.0, 1.0)), 0, 255).astype(np.uint8)


def test_sobel_gives_slopes_in_grey_levels_per_pixel():
    y, x = np.mgrid[0:20, 0:20].astype(np.float32)
    gx, gy = sobel(3.0 * x - 2.0 * y)
    assert gx[5:-5, 5:-5] == pytest.approx(3.0)
    assert gy[5:-5, 5:-5] == pytest.approx(-2.0)


def test_strength_is_equation_4_1():
    gx, gy = np.full((2, 2), 3.0, np.float32), np.full((2, 2), 4.0, np.float32)
    assert edge_strength(gx, gy) == pytest.approx(np.sqrt((9.0 + 16.0) / 2.0))


@pytest.mark.parametrize(
    ("gx", "gy", "expected"), [(0, 0, 0), (0, 1, 0), (1, 1, 1), (-1, -1, 1), (1, 0, 2), (1, -1, 3)]
)
def test_directions_fall_into_four_classes(gx, gy, expected):
    one = np.ones((1, 1), np.float32)
    assert direction_classes(gx * one, gy * one)[0, 0] == expected


@pytest.mark.parametrize("degrees", [0.0, 45.0, 90.0, 135.0, 22.0, 70.0])
def test_thinned_edges_are_one_pixel_wide(degrees):
    gx, gy = sobel(smoothed(step_image(np.deg2rad(degrees)), 1.0))
    thin = suppress_non_maxima(edge_strength(gx, gy), direction_classes(gx, gy), 1.0)[10:-10, 10:-10] > 0.0
    across = thin.sum(axis=1) if abs(np.cos(np.deg2rad(degrees))) > 0.7 else thin.sum(axis=0)
    assert set(across) <= {1, 2}  # two where a diagonal runs as a stair


def test_hysteresis_keeps_weak_pixels_joined_to_strong_ones_only():
    strength = np.zeros((5, 12), np.float32)
    strength[2, 1:5] = (2.0, 2.0, 5.0, 2.0)
    strength[2, 7:11] = 2.0
    kept = hysteresis(strength, 1.0, 4.0)
    assert kept[2].tolist() == [False] + [True] * 4 + [False] * 7


def test_canny_agrees_with_opencv():
    photo = rectangles(np.random.default_rng(1), noise=1.0)
    options = EdgeOptions(high_threshold=4.0, low_threshold=2.0)
    ours = canny(photo.image, options)
    # gradients in opencv's units: sums of the masks, magnitude without the 1/√2 of (4.1)
    scale = 8.0 * np.sqrt(2.0)
    dx, dy = ((8.0 * g).round().astype(np.int16) for g in (ours.gx, ours.gy))
    theirs = cv2.Canny(dx, dy, 2.0 * scale, 4.0 * scale, L2gradient=True) > 0
    assert np.count_nonzero(ours.edges & theirs) / np.count_nonzero(ours.edges | theirs) > 0.97


def test_noise_gain_is_the_scatter_of_slopes_in_noise():
    noise = np.random.default_rng(2).normal(0.0, 5.0, (300, 300)).astype(np.float32)
    gx, _ = sobel(np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.3)))
    assert gx.std() / 5.0 == pytest.approx(noise_gain(1.3), rel=0.03)


@pytest.mark.parametrize("std", [1.0, 3.0, 8.0])
def test_noise_is_estimated_beside_edges(std):
    photo = rectangles(np.random.default_rng(3), noise=std, contrast=(80.0, 80.0))
    assert noise_std(photo.image) == pytest.approx(std, rel=0.1)


def test_given_thresholds_are_used():
    grey = step_image(0.3)
    strength = edge_strength(*sobel(smoothed(grey, 1.0)))
    assert thresholds(grey, strength, EdgeOptions(high_threshold=9.0, low_threshold=3.0)) == (3.0, 9.0)


def test_more_noise_raises_the_thresholds():
    def high(noise):
        grey = rectangles(np.random.default_rng(4), noise=noise).image
        return thresholds(grey, edge_strength(*sobel(smoothed(grey, 1.0))), EdgeOptions())[1]

    assert high(2.0) < high(4.0) < high(8.0)


def test_pure_noise_has_hardly_any_edges():
    grey = np.clip(np.random.default_rng(5).normal(120.0, 6.0, (400, 500)), 0, 255).astype(np.uint8)
    assert len(edge_chains(grey, EdgeOptions())) <= 2


def test_colour_photos_are_weighted_to_grey():
    colour = np.zeros((4, 5, 3), np.uint8)
    colour[..., 0] = 200
    assert grey_image(colour)[0, 0] == round(0.299 * 200)


def test_half_photo_averages_four_pixels():
    grey = np.arange(20, dtype=np.uint8).reshape(4, 5)
    assert halved(grey) == pytest.approx(np.array([[3.0, 5.0], [13.0, 15.0]]), abs=0.5)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 150.0, 179.5])
def test_hough_finds_the_line_of_a_step(degrees):
    angle = np.deg2rad(degrees)
    image = canny(step_image(angle, size=201), EdgeOptions())
    lines = peaks(vote(image), 80)
    turn = np.angle(np.exp(2j * (lines.normals_rad[0] - angle))) / 2.0
    middle = 100.0 * (np.cos(lines.normals_rad[0]) + np.sin(lines.normals_rad[0]))
    assert abs(np.rad2deg(turn)) < 1.0
    assert abs(lines.distances_px[0] - middle) < 1.0


def test_cells_beside_a_maximum_are_suppressed_also_across_180_degrees():
    votes = np.zeros((90, 101), np.int32)
    votes[0, 60], votes[89, 41], votes[40, 50] = 30, 25, 20
    space = HoughSpace(votes, np.pi / 90.0, 1.0, -50.0)
    # r = 10 at 0° and r = -9 at 178° are neighbours: 178° is -2° with r = 9
    assert len(peaks(space, 10).normals_rad) == 2


def test_hough_angles_get_finer_with_the_photo():
    assert angle_step(640, 480) == pytest.approx(1.0 / 400.0, rel=0.01)
    assert angle_step(1280, 960) == pytest.approx(1.0 / 800.0, rel=0.01)


def test_tracking_finds_start_and_end_of_an_edge():
    grey = np.full((80, 120), 100, np.uint8)
    grey[40:, 30:91] = 180
    image = canny(grey, EdgeOptions())
    pieces = track_lines(image, np.array([np.pi / 2.0]), np.array([39.5]), gap_px=5, least_px=20.0)
    assert pieces == pytest.approx(np.array([[30.5, 39.5, 89.5, 39.5]]), abs=2.5)


def test_tracking_cuts_a_line_at_gaps():
    grey = np.full((80, 160), 100, np.uint8)
    grey[40:, 10:60], grey[40:, 100:150] = 180, 180
    image = canny(grey, EdgeOptions())
    pieces = track_lines(image, np.array([np.pi / 2.0]), np.array([39.5]), gap_px=5, least_px=20.0)
    assert len(pieces) == 2


def test_half_circles_grow_along_a_drawn_line():
    edges = np.zeros((100, 160), np.uint8)
    cv2.line(edges, (12, 20), (140, 75), 1)
    (piece,) = grow_segments(edges.astype(bool), 20.0, 5.0)
    ends = sorted(piece.reshape(2, 2).tolist())
    assert np.asarray(ends) == pytest.approx(np.array([[12.0, 20.0], [140.0, 75.0]]), abs=6.0)  # the radius


@pytest.mark.parametrize("shape", ["arctan", "gaussian"])
def test_profile_fit_finds_the_edge_that_made_the_profile(shape):
    t = np.arange(-8.0, 9.0)
    fit = fit_profile(t, 90.0 + 60.0 * edge_function((t - 0.37) / 1.1, shape)[0], shape)
    assert fit.position == pytest.approx(0.37, abs=1e-6)
    assert (fit.width, fit.middle, fit.contrast) == pytest.approx((1.1, 90.0, 60.0), abs=1e-5)


def test_profile_fit_finds_falling_edges():
    t = np.arange(-6.0, 7.0)
    fit = fit_profile(t, 90.0 - 40.0 / np.pi * np.arctan((t + 1.2) / 0.8))
    assert (fit.position, fit.contrast) == pytest.approx((-1.2, -40.0), abs=1e-5)


def test_covariance_of_a_profile_fit_is_true():
    rng, t = np.random.default_rng(6), np.arange(-8.0, 9.0)
    clean = 90.0 + 60.0 / np.pi * np.arctan((t - 0.3) / 1.2)
    fits = [fit_profile(t, clean + rng.normal(0.0, 2.0, len(t))) for _ in range(200)]
    normalised = [(f.position - 0.3) / np.sqrt(f.covariance[0, 0]) for f in fits]
    # 13 degrees of freedom each and 200 samples: the scatter is known to 6 %
    assert np.std(normalised) == pytest.approx(1.0, abs=0.2)


def test_a_flat_profile_is_refused():
    with pytest.raises(InvalidInputError, match="no edge"):
        fit_profile(np.arange(9.0), np.full(9, 50.0))


def lines(*ends):
    return lines_between(np.array(ends, dtype=np.float64).reshape(-1, 2, 2), 1.0, 3.0)


def test_collinear_pieces_become_one():
    merged = merge_collinear(lines((0, 0, 40, 0.2), (44, 0.1, 90, 0.3), (95, 0.2, 120, 0.2)), 8.0)
    assert merged.lengths == pytest.approx([120.0], abs=0.1)


def test_pieces_with_opposite_bright_sides_stay_apart():
    assert len(merge_collinear(lines((0, 0, 40, 0), (90, 0, 44, 0)), 8.0)) == 2


def test_pieces_far_apart_or_bent_stay_apart():
    assert len(merge_collinear(lines((0, 0, 40, 0), (60, 0, 90, 0), (0, 30, 40, 30), (42, 30.5, 80, 33.8)), 8.0)) == 4


def test_the_shorter_of_two_lines_on_one_edge_is_left_out():
    kept = without_doubles(lines((0, 0, 100, 0), (20, 0.8, 60, -1.4), (0, 3, 100, 3)))
    assert sorted(kept.lengths) == pytest.approx([100.0, 100.0])


def test_a_missing_line_segment_detector_is_said_clearly(monkeypatch):
    monkeypatch.delattr(line_detectors.cv2, "createLineSegmentDetector")
    with pytest.raises(InvalidInputError, match="edge-chains"):
        line_detectors.lsd(step_image(0.2), EdgeOptions())


@pytest.mark.parametrize(("second_px", "pieces"), [(60, 2), (15, 1)])
def test_a_line_over_a_gap_becomes_an_edge_on_each_side_that_is_long_enough(second_px: int, pieces: int) -> None:
    values = np.full((80, 320), 100.0)
    for left, right in ((40, 160), (200, 200 + second_px)):
        values[40:, left:right] = 160.0
    values = cv2.GaussianBlur(values, (0, 0), 1.0) + np.random.default_rng(1).normal(0.0, 2.0, values.shape)
    grey = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    whole = lines_between(np.array([[[40.0, 39.5], [200.0 + second_px, 39.5]]]), 1.0, 3.5)
    walked = walk_along(grey, whole, None, EdgeOptions(min_length_px=30.0))
    ends = np.sort((walked.centres[:, 0, None] + walked.extents * walked.directions[:, :1]), axis=0)
    assert len(walked) == pieces
    np.testing.assert_allclose(ends[0], [40.0, 160.0], atol=4.0)
    if pieces == 2:
        np.testing.assert_allclose(ends[1], [200.0, 260.0], atol=4.0)
