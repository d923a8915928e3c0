"""Laws that found edges obey, and photos without edges."""

from typing import get_args

import numpy as np
import pytest

from algorithms.errors import InvalidInputError
from algorithms.geometry.cameras import Camera
from algorithms.photos.detector import detect_edges
from algorithms.photos.options import EdgeDetector, EdgeOptions
from algorithms.progress import NoProgress
from tests.scenes.photos.edge_images import find, rectangles

SIZE = (240, 200)


@pytest.fixture(scope="module")
def photo():
    return rectangles(np.random.default_rng(1), size=SIZE, across=2, contrast=(50.0, 90.0), noise=3.0)


@pytest.fixture(scope="module")
def edges(photo):
    return find(photo.image)


def nearest(segments, point):
    return segments[np.array([np.argmin(np.linalg.norm(segments.centres - point, axis=1))])]


def test_edges_are_sorted_by_length(edges):
    assert len(edges) >= 16
    assert np.all(np.diff(edges.lengths) <= 0.0)


def test_the_brighter_side_lies_on_the_side_of_the_normal(photo, edges):
    middle = edges.centres + edges.extents.mean(axis=1)[:, None] * edges.directions
    sides = [np.rint(middle + s * edges.normals).astype(int) for s in (3.0, -3.0)]
    bright, dark = (photo.image[side[:, 1], side[:, 0]].astype(float) for side in sides)
    assert np.all(bright > dark)


def test_a_turned_photo_has_turned_edges(photo, edges):
    turned = find(np.ascontiguousarray(np.rot90(photo.image)))
    assert len(turned) == len(edges)
    for k in range(len(edges)):
        x, y = edges.centres[k]
        twin = nearest(turned, np.array([y, SIZE[0] - 1.0 - x]))
        d = np.array([edges.directions[k, 1], -edges.directions[k, 0]])
        # cells, links and patches are met in another order: a fifth of the standard deviation of some 0.02 px
        assert twin.directions[0] @ d > np.cos(2e-3)


def test_a_negative_has_the_same_edges_with_directions_reversed(photo, edges):
    negative = find(255 - photo.image)
    assert len(negative) == len(edges)
    for k in range(len(edges)):
        twin = nearest(negative, edges.centres[k])
        assert twin.directions[0] @ edges.directions[k] < -0.999


def test_colour_and_grey_photos_have_the_same_edges(photo, edges):
    colour = find(np.repeat(photo.image[:, :, None], 3, axis=2))
    assert colour.centres == pytest.approx(edges.centres)


def test_same_photo_gives_the_same_edges(photo, edges):
    assert np.array_equal(find(photo.image).covariances, edges.covariances)


def test_a_camera_without_distortion_changes_nothing(photo, edges):
    seen = find(photo.image, Camera(*SIZE, 300.0, 300.0, 120.0, 100.0))
    assert seen.ends == pytest.approx(edges.ends)


def test_raw_ends_are_the_distorted_ends(photo):
    camera = Camera(*SIZE, 300.0, 300.0, 120.0, 100.0, k1=-0.1)
    seen = find(photo.image, camera)
    assert seen.raw_ends.reshape(-1, 2) == pytest.approx(camera.image_from_ideal(seen.ends.reshape(-1, 2)))


def test_covariances_at_the_ends_follow_from_angle_and_offset(edges):
    k = 3
    s, e = edges.extents[k]
    angle, offset = np.diag(edges.covariances[k])
    assert edges.end_covariances[k] == pytest.approx(
        np.array([[offset + s * s * angle, offset + s * e * angle], [offset + s * e * angle, offset + e * e * angle]])
    )


def test_at_most_as_many_edges_as_asked_for(photo):
    assert len(find(photo.image, max_segments=5)) == 5


def test_short_and_faint_edges_are_left_out_on_request(photo):
    chosen = find(photo.image, min_length_px=50.0, min_contrast=60.0)
    assert chosen.lengths.min() >= 50.0
    assert chosen.contrasts.min() >= 60.0


@pytest.mark.parametrize("detector", get_args(EdgeDetector))
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (7, 7), (9, 9), (33, 40)])
def test_blank_and_tiny_photos_have_no_edges(detector, shape):
    assert len(find(np.full(shape, 127, np.uint8), detector=detector)) == 0


@pytest.mark.parametrize("detector", get_args(EdgeDetector))
def test_photos_of_noise_only_have_hardly_any_edges(detector):
    grey = np.random.default_rng(2).integers(0, 255, (120, 150)).astype(np.uint8)
    assert len(find(grey, detector=detector)) <= 3


def test_two_colours_and_nothing_between_give_their_border():
    grey = np.zeros((60, 80), np.uint8)
    grey[:, 40:] = 255
    (x,) = find(grey).centres[:, 0]
    assert x == pytest.approx(39.5, abs=0.02)


@pytest.mark.parametrize("shape", [(0, 5), (5, 0)])
def test_photos_without_pixels_are_refused(shape):
    with pytest.raises(InvalidInputError, match="photo"):
        find(np.zeros(shape, np.uint8))


def test_photos_beyond_all_measure_are_refused():
    with pytest.raises(InvalidInputError, match="at most"):
        find(np.broadcast_to(np.uint8(3), (40_000, 10)))


def test_a_photo_of_another_size_than_its_camera_is_refused(photo):
    with pytest.raises(InvalidInputError, match="calibrated"):
        detect_edges(photo.image, Camera(640, 480, 600.0, 600.0, 320.0, 240.0), EdgeOptions(), progress=NoProgress())
