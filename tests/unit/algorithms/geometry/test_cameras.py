"""Cameras project, distort and go back exactly."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import InvalidInputError
from algorithms.geometry.camera_mounts import (
    CameraAxes,
    camera_from_axes,
    scan_from_camera_with_axes,
    scan_from_mounted_camera,
)
from algorithms.geometry.cameras import Camera

# A six megapixel camera of a scanner with a 14 mm lens, and a strong wide angle.
MOUNTED = Camera(3008, 2000, 1792.4, 1793.1, 1510.3, 995.9, -0.104, 0.098, -0.021, 3e-4, -5e-4)
WIDE = Camera(1280, 1024, 620.0, 615.0, 655.0, 500.0, -0.28, 0.09, -0.002, 1e-3, 2e-3)
PINCUSHION = Camera(1000, 800, 900.0, 905.0, 480.0, 410.0, 0.12, 0.02, 0.0, -5e-4, 3e-4)
PINHOLE = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
CAMERAS = {"mounted": MOUNTED, "wide": WIDE, "pincushion": PINCUSHION, "pinhole": PINHOLE}

all_cameras = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())


def _pixels(camera: Camera, count: int = 500) -> np.ndarray:
    rng = np.random.default_rng(5)
    rim = np.array([(x, y) for x in (-0.5, camera.width - 0.5) for y in (-0.5, camera.height - 0.5)])
    return np.vstack([rim, rng.uniform(-0.5, np.array([camera.width, camera.height]) - 0.5, size=(count, 2))])


def _points(camera: Camera) -> np.ndarray:
    rays = camera.rays_from_ideal(camera.ideal_from_image(_pixels(camera)))
    return rays * np.random.default_rng(6).uniform(0.5, 90.0, size=(len(rays), 1))


def _difference_quotients(function: object, at: np.ndarray, step: float) -> np.ndarray:
    """Central differences: (n, out, in)."""
    columns = []
    for k in range(at.shape[1]):
        shift = np.zeros(at.shape[1])
        shift[k] = step
        columns.append((function(at + shift) - function(at - shift)) / (2.0 * step))  # type: ignore[operator]
    return np.stack(columns, axis=2)


@all_cameras
def test_distorting_what_was_undistorted_gives_the_pixel_back(camera: Camera) -> None:
    image = _pixels(camera)
    np.testing.assert_allclose(camera.image_from_ideal(camera.ideal_from_image(image)), image, atol=1e-9)


@all_cameras
def test_points_along_the_ray_of_a_pixel_have_their_image_there(camera: Camera) -> None:
    np.testing.assert_allclose(camera.image_from_camera(_points(camera)), _pixels(camera), atol=1e-9)


@all_cameras
def test_projection_agrees_with_opencv(camera: Camera) -> None:
    points = _points(camera)
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    np.testing.assert_allclose(camera.image_from_camera(points), expected[:, 0], atol=1e-9)


@all_cameras
def test_undistortion_agrees_with_opencv(camera: Camera) -> None:
    image = _pixels(camera)
    # The simple iteration of OpenCV needs some hundred steps in the corners of the wide angle.
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 2000, 1e-13)
    arguments = (camera.matrix, np.array(camera.distortion))
    expected = cv2.undistortPoints(image[:, None], *arguments, P=camera.matrix, criteria=until)
    np.testing.assert_allclose(camera.ideal_from_image(image), expected[:, 0], atol=1e-7)


@all_cameras
def test_jacobians_of_the_distortion_are_its_differences(camera: Camera) -> None:
    ideal = camera.ideal_from_image(_pixels(camera))
    expected = _difference_quotients(camera.image_from_ideal, ideal, 1e-2)
    np.testing.assert_allclose(camera.image_jacobians(ideal), expected, atol=1e-8)


@all_cameras
def test_jacobians_of_the_undistortion_are_its_differences(camera: Camera) -> None:
    image = _pixels(camera)[4:]
    expected = _difference_quotients(camera.ideal_from_image, image, 1e-2)
    np.testing.assert_allclose(camera.ideal_jacobians(camera.ideal_from_image(image)), expected, atol=1e-7)


@all_cameras
def test_jacobians_of_the_projection_are_its_differences(camera: Camera) -> None:
    points = _points(camera)
    points *= 10.0 / points[:, 2:]
    expected = _difference_quotients(camera.ideal_from_camera, points, 1e-4)
    np.testing.assert_allclose(camera.projection_jacobians(points), expected, rtol=1e-7, atol=1e-6)


@all_cameras
def test_jacobians_of_rays_are_their_differences(camera: Camera) -> None:
    ideal = camera.ideal_from_image(_pixels(camera))
    expected = _difference_quotients(camera.rays_from_ideal, ideal, 1e-1)
    np.testing.assert_allclose(camera.ray_jacobians(ideal), expected, atol=1e-10)


def test_rays_have_unit_length_and_point_forward() -> None:
    rays = WIDE.rays_from_ideal(WIDE.ideal_from_image(_pixels(WIDE)))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-15)
    assert rays[:, 2].min() > 0.0


def test_what_is_on_the_right_and_below_has_larger_columns_and_rows() -> None:
    ((x, y),) = PINHOLE.image_from_camera(np.array([[1.0, 2.0, 10.0]]))
    assert (x, y) == (319.5 + 50.0, 239.5 + 100.0)


def test_points_behind_the_camera_are_not_projectable() -> None:
    points = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.1, 0.0, 0.0]])
    np.testing.assert_array_equal(PINHOLE.projectable(points), [True, False, False])


def test_points_beyond_the_fold_of_the_distortion_are_not_projectable() -> None:
    camera = Camera(640, 480, 700.0, 700.0, 319.5, 239.5, k1=-0.3)
    # 1 - 0.9 r² = 0
    assert camera.max_radius == pytest.approx(np.sqrt(1.0 / 0.9), rel=1e-12)
    points = np.array([[1.05, 0.0, 1.0], [1.06, 0.0, 1.0]])
    np.testing.assert_array_equal(camera.projectable(points), [True, False])
    with pytest.raises(InvalidInputError, match="reach of the lens distortion"):
        camera.image_from_camera(points)


def test_projecting_a_point_behind_the_camera_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="behind the camera"):
        PINHOLE.image_from_camera(np.array([[0.0, 0.0, -1.0]]))


def test_the_photo_ends_half_a_pixel_beyond_its_outer_pixel_centres() -> None:
    image = np.array([[-0.5, -0.5], [639.5, 479.5], [-0.6, 3.0], [5.0, 479.6]])
    np.testing.assert_array_equal(PINHOLE.inside(image), [True, True, False, False])


@pytest.mark.parametrize(
    "changes",
    [
        {"width": 0},
        {"height": -480},
        {"fx": 0.0},
        {"fy": -500.0},
        {"fx": float("nan")},
        {"cx": float("inf")},
        {"k1": float("nan")},
        {"k1": -3.0},
        {"k1": 0.1, "k2": -9.0},
        {"p1": 1.0},
    ],
)
def test_absurd_parameters_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError):
        replace(PINHOLE, **changes)


# --- mounts ---------------------------------------------------------------------------------------------------------


def _pose(seed: int) -> RigidTransform:
    rng = np.random.default_rng(seed)
    return RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))


def test_the_chain_of_a_turning_head_is_its_turn_times_the_inverse_mount() -> None:
    mount, angle = _pose(1), 0.7
    cosine, sine = np.cos(angle), np.sin(angle)
    head = np.array([[cosine, -sine, 0, 0], [sine, cosine, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    expected = head @ np.linalg.inv(mount.as_matrix())
    np.testing.assert_allclose(scan_from_mounted_camera(mount, angle).as_matrix(), expected, atol=1e-14)


def test_the_camera_turns_with_the_head_about_the_scanners_z_axis() -> None:
    mount = _pose(2)
    first, second = (scan_from_mounted_camera(mount, angle) for angle in (0.2, 1.3))
    turn = second * first.inv()
    np.testing.assert_allclose(turn.rotation.as_rotvec(), [0.0, 0.0, 1.1], atol=1e-14)
    np.testing.assert_allclose(turn.translation, 0.0, atol=1e-14)


def test_a_head_angle_that_is_no_number_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="head angle"):
        scan_from_mounted_camera(_pose(3), float("nan"))


@pytest.mark.parametrize(
    ("axes", "forward", "right", "up"),
    [
        (CameraAxes.RIGHT_DOWN_FORWARD, (0, 0, 1), (1, 0, 0), (0, -1, 0)),
        (CameraAxes.RIGHT_UP_BACKWARD, (0, 0, -1), (1, 0, 0), (0, 1, 0)),
        (CameraAxes.FORWARD_LEFT_UP, (1, 0, 0), (0, -1, 0), (0, 0, 1)),
    ],
)
def test_forward_right_and_up_of_every_kind_of_axes_become_opencvs(
    axes: CameraAxes, forward: tuple[int, ...], right: tuple[int, ...], up: tuple[int, ...]
) -> None:
    there = camera_from_axes(axes).apply(np.array([forward, right, up], dtype=np.float64))
    np.testing.assert_allclose(there, [(0, 0, 1), (1, 0, 0), (0, -1, 0)], atol=1e-15)


@pytest.mark.parametrize("axes", list(CameraAxes))
def test_a_point_in_front_stays_in_front_when_the_axes_are_converted(axes: CameraAxes) -> None:
    scan_from_other = _pose(4)
    in_other = camera_from_axes(axes).inv().apply(np.array([0.3, -0.2, 5.0]))
    in_camera = scan_from_camera_with_axes(scan_from_other, axes).inv().apply(scan_from_other.apply(in_other))
    np.testing.assert_allclose(in_camera, [0.3, -0.2, 5.0], atol=1e-14)
