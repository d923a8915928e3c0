"""A contour measured in a photo lies on the model's outline, and where the model is too small it says by how much."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.deviations.triangles import Mesh
from algorithms.geometry.cameras import Camera
from algorithms.meshing.contour_cones import contour_on_model
from algorithms.scans.open3d_loading import import_open3d

CAMERA = Camera(width=1200, height=900, fx=1000.0, fy=1000.0, cx=599.5, cy=449.5, k1=-0.05, k2=0.01)
EYE_M = np.array([0.5, -4.0, 1.0])
RADIUS_M = 0.5


def ball(radius_m: float, resolution: int = 150) -> Mesh:
    made = import_open3d().geometry.TriangleMesh.create_sphere(radius_m, resolution)
    return Mesh(np.asarray(made.vertices), np.asarray(made.triangles).astype(np.int64))


def looking_at_the_origin() -> PlacedPhoto:
    forward = -EYE_M / np.linalg.norm(EYE_M)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.column_stack([right, np.cross(forward, right), forward])
    pose = RigidTransform.from_components(EYE_M, Rotation.from_matrix(axes))
    return PlacedPhoto("photo", "station", CAMERA, pose, lambda: np.zeros((900, 1200, 3), dtype=np.uint8))


def outline(radius_m: float) -> tuple[Array, Array]:
    """Points of the circle in which the cone from the eye touches a ball, and their pixels."""
    distance = float(np.linalg.norm(EYE_M))
    middle = EYE_M / distance * (radius_m**2 / distance)
    across = radius_m * np.sqrt(1.0 - (radius_m / distance) ** 2)
    one = np.cross(EYE_M, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one)
    other = np.cross(EYE_M / distance, one)
    turn = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)[:, None]
    points = middle + across * (np.cos(turn) * one + np.sin(turn) * other)
    pixels = CAMERA.image_from_camera(looking_at_the_origin().common_from_camera.inv().apply(points))
    return points, pixels


def test_the_outline_of_a_ball_is_found_to_a_pixel_and_lies_where_the_cone_touches() -> None:
    points, pixels = outline(RADIUS_M)
    found = contour_on_model(ball(RADIUS_M), looking_at_the_origin(), pixels, 10.0)
    assert np.abs(found.gaps_px).max() < 1.0
    np.testing.assert_allclose(found.points_m, points, atol=0.02)
    assert np.sqrt(np.mean((np.linalg.norm(found.points_m, axis=1) - RADIUS_M) ** 2)) < 0.001


@pytest.mark.parametrize(("model_m", "sign"), [(0.49, 1.0), (0.51, -1.0)])
def test_a_model_too_small_or_too_large_is_told_by_the_sign_and_size_of_its_gap(model_m: float, sign: float) -> None:
    _, pixels = outline(RADIUS_M)
    found = contour_on_model(ball(model_m), looking_at_the_origin(), pixels, 20.0)
    assert np.median(found.gaps_m) == pytest.approx(sign * 0.01, abs=0.001)


def test_what_another_body_hides_is_no_outline_and_what_is_far_from_any_is_not_laid() -> None:
    _, pixels = outline(RADIUS_M)
    before, behind = ball(RADIUS_M), ball(0.3, 40)
    shifted = behind.vertices - 1.5 * EYE_M / np.linalg.norm(EYE_M)
    both = Mesh(
        np.concatenate([before.vertices, shifted]),
        np.concatenate([before.triangles, behind.triangles + len(before.vertices)]),
    )
    middle = np.array([[599.5, 449.5]])
    found = contour_on_model(both, looking_at_the_origin(), np.vstack([pixels, middle]), 60.0)
    assert np.abs(found.gaps_px[:-1]).max() < 1.0
    assert np.isnan(found.gaps_px[-1])
    assert np.isnan(found.points_m[-1]).all()
