"""Lines of photos beside those of the scan: order, covariance with the mount's error, and what became of every edge."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.errors import InvalidInputError
from algorithms.features.photo_lines.photo_counts import photos_without_lines
from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.photo_lines import add_photo_lines
from algorithms.features.photo_lines.projection_options import SpaceEdgeKind
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.camera_mounts import CameraAxes, camera_from_axes
from algorithms.geometry.lines import LineSource, lines_from_arrays
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.progress import NoProgress
from service.use_cases.steps.feature_store import load_features, save_features
from tests.scenes.photos.photo_scenes import line_errors, looking, normalised_errors
from tests.scenes.photos.photo_wall import (
    CAMERA,
    NOISE_M,
    SCAN_FROM_CAMERA,
    nearest_side,
    true_sides,
    wall_photo,
    wall_scan,
)
from tests.unit.service.use_cases.steps.test_feature_store import same, some_features

TIGHT = mount_covariance(1e-7, 1e-6)
OPTIONS = PhotoLineOptions()


def scan_lines() -> ScanFeatures:
    anchors = np.array([[3.0, 1.0, 0.0], [1.0, 2.0, 2.0]])
    lines = lines_from_arrays(
        anchors, np.eye(3)[:2], np.tile(1e-6 * np.eye(4), (2, 1, 1)), np.tile([-1.0, 1.0], (2, 1))
    )
    return replace(some_features(), lines=lines, origin_m=np.zeros(3), noise_std_m=NOISE_M)


def photo(covariance: np.ndarray = TIGHT, seed: int = 2) -> StationPhoto:
    return StationPhoto(wall_photo(seed), CAMERA, SCAN_FROM_CAMERA, covariance)


def added(*photos: StationPhoto) -> ScanFeatures:
    return add_photo_lines(scan_lines(), wall_scan(), photos, OPTIONS, count=len(photos), progress=NoProgress())


@pytest.fixture(scope="module")
def one() -> ScanFeatures:
    return added(photo())


@pytest.fixture(scope="module")
def two() -> ScanFeatures:
    return added(photo(mount_covariance(2e-3, 0.01), seed=3), photo())


def test_lines_of_the_scan_stay_first_and_unchanged(one: ScanFeatures) -> None:
    before, lines = scan_lines().lines, one.lines
    assert lines.photos is not None
    assert lines.photo_jacobians is not None
    np.testing.assert_array_equal(lines.anchors[:2], before.anchors)
    np.testing.assert_array_equal(lines.covariances[:2], before.covariances)
    assert (lines.photos[:2] == -1).all()
    assert not lines.photo_jacobians[:2].any()


def test_the_four_sides_of_a_painted_rectangle_are_added(one: ScanFeatures) -> None:
    lines = one.lines[2:]
    assert (lines.sources == int(LineSource.PHOTO_EDGE)).all()
    assert {nearest_side(a, d) for a, d in zip(lines.anchors, lines.directions, strict=True)} == {0, 1, 2, 3}


def test_added_lines_are_true_within_their_covariance(one: ScanFeatures) -> None:
    lines = one.lines[2:]
    sides = [nearest_side(a, d) for a, d in zip(lines.anchors, lines.directions, strict=True)]
    starts, ends = true_sides()
    squares = normalised_errors(lines, line_errors(lines, starts[sides], ends[sides]))
    # chi-square with four degrees of freedom: 23.5 is exceeded once in ten thousand
    assert squares.max() < 23.5


def test_covariances_contain_the_error_of_the_mount() -> None:
    rough = mount_covariance(2e-3, 0.01)
    tight, loose = added(photo()).lines[2:], added(photo(rough)).lines[2:]
    jacobians = loose.photo_jacobians
    assert jacobians is not None
    expected = jacobians @ (rough - TIGHT) @ np.swapaxes(jacobians, 1, 2)
    np.testing.assert_allclose(loose.covariances - tight.covariances, expected, rtol=1e-9, atol=1e-15)


def test_what_two_photos_show_is_one_line_each_which_depends_on_both(two: ScanFeatures) -> None:
    assert two.photo_edges is not None
    assert two.lines.photos is not None
    assert two.lines.second_photos is not None
    assert two.photo_edges.merged_counts.tolist() == [0, 4]
    both = np.column_stack([two.lines.photos, two.lines.second_photos])
    assert np.sort(both, axis=1).tolist() == [[-1, -1]] * 2 + [[0, 1]] * 4


def test_merged_lines_are_as_certain_as_those_of_the_better_mounted_camera(
    one: ScanFeatures, two: ScanFeatures
) -> None:
    sides = [
        [nearest_side(a, d) for a, d in zip(f.lines.anchors[2:], f.lines.directions[2:], strict=True)]
        for f in (one, two)
    ]
    assert sides[0] == sides[1]
    ratios = two.lines.covariances[2:, [2, 3], [2, 3]].sum(axis=1) / one.lines.covariances[2:, [2, 3], [2, 3]].sum(
        axis=1
    )
    # photo 1 of the two is the one; its anchors and weights differ a little
    assert ratios.max() < 1.01


def test_a_scan_of_a_bare_wall_has_nothing_to_test_the_mounts_by(two: ScanFeatures) -> None:
    assert two.mount_test is not None
    assert two.mount_test.degrees_of_freedom == 0
    assert two.mount_test.in_words() is None


def test_each_photo_keeps_the_covariance_of_its_mount(two: ScanFeatures) -> None:
    np.testing.assert_array_equal(two.photo_covariances, [mount_covariance(2e-3, 0.01), TIGHT])


def test_every_edge_became_a_line_or_has_a_reason(two: ScanFeatures) -> None:
    found = two.photo_edges
    assert found is not None
    np.testing.assert_array_equal(found.segment_counts, found.projected_counts + found.rejection_counts.sum(axis=1))


def test_surfaces_of_added_lines_are_told(one: ScanFeatures) -> None:
    found = one.photo_edges
    assert found is not None
    assert found.line_kinds[:2].tolist() == [-1, -1]
    assert set(found.line_kinds[2:].tolist()) == {int(SpaceEdgeKind.SURFACE_EDGE)}
    # the wall looks back along the scan's x axis
    np.testing.assert_allclose(found.line_normals[2:, 0], -1.0, atol=0.01)


def test_a_photo_that_is_not_of_its_camera_is_refused() -> None:
    wrong = replace(photo(), camera=replace(CAMERA, width=320, cx=160.0))
    with pytest.raises(InvalidInputError, match="640 by 480"):
        added(wrong)


def test_features_with_photos_are_stored_bit_for_bit(tmp_path: Path, two: ScanFeatures) -> None:
    save_features(tmp_path / "f.npz", two)
    assert same(load_features(tmp_path / "f.npz"), two)


def with_sides_in_the_scan() -> ScanFeatures:
    """Let the scan show the sides of the rectangle too."""
    starts, ends = true_sides()
    half = 0.5 * np.linalg.norm(ends - starts, axis=1)
    sides = lines_from_arrays(
        0.5 * (starts + ends), (ends - starts) / (2.0 * half[:, None]), np.tile(1e-6 * np.eye(4), (4, 1, 1)),
        np.column_stack([-half, half]),
    )  # fmt: skip
    return replace(scan_lines(), lines=sides)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (SCAN_FROM_CAMERA, None),
        (SCAN_FROM_CAMERA.inv(), "inverse of scan_from_camera"),
        (SCAN_FROM_CAMERA * camera_from_axes(CameraAxes.RIGHT_UP_BACKWARD), "right-up-backward in place of"),
        (SCAN_FROM_CAMERA * camera_from_axes(CameraAxes.FORWARD_LEFT_UP), "forward-left-up in place of"),
        (SCAN_FROM_CAMERA * looking(yaw_rad=1.5), None),
    ],
)
def test_a_pose_that_is_inverted_or_of_other_axes_is_named(stated: RigidTransform, words: str | None) -> None:
    photos = [StationPhoto(wall_photo(2), CAMERA, stated, mount_covariance(2e-4, 0.001))]
    found = add_photo_lines(with_sides_in_the_scan(), wall_scan(), photos, OPTIONS, count=1, progress=NoProgress())
    named = [text for text in photos_without_lines(found) if "is found again in the scan as" in text]
    assert len(named) == (words is not None)
    assert all(str(words) in text and "4 are with" in text for text in named)
