"""Colours of rendered photos reach the points, hidden points stay black, and exposures are balanced."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.cleaning.best_view import point_normals
from algorithms.cleaning.cleaned_stations import placed
from algorithms.colouring.coloured_cloud import ColouredCloud, coloured_cloud
from algorithms.colouring.options import ColouringOptions
from algorithms.colouring.photo_views import PlacedPhoto, view_of
from algorithms.geometry.cameras import Camera
from algorithms.progress import NoProgress
from algorithms.simulation.rendering import station_photos
from algorithms.simulation.rendering_shading import Shading
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.sun import MORNING
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera

EXPOSURES = (1.1, 0.9)
CAMERA = Camera(width=200, height=200, fx=100.0, fy=100.0, cx=99.5, cy=99.5)


@pytest.fixture(scope="module")
def rendered() -> tuple[np.ndarray, np.ndarray, list[PlacedPhoto], np.ndarray]:
    """Scan and photograph the front of the house from two stations; give points, normals, photos and true colours."""
    scene, points, normals, true = SCENES["house_front"](), [], [], []
    photos: list[PlacedPhoto] = []
    shading = Shading(scene, MORNING)
    for number, pose in enumerate(scene.stations[:2]):
        rng = np.random.default_rng(number)
        scan = scan_scene(scene, pose, VirtualScanner(rows=250, columns=600, mixed_pixels=False), rng)
        points.append(placed(scan, pose, np.zeros(3)).points())
        found = point_normals(scan)
        found[np.einsum("ij,ij->i", found, scan.points) > 0.0] *= -1.0
        normals.append(pose.rotation.apply(found))
        rays = points[-1] - pose.translation
        true.append(
            255.0 * shading.look(np.asarray(pose.translation), rays / np.linalg.norm(rays, axis=1)[:, None]).colors
        )
        camera = VirtualCamera(camera=scanner_camera(0.2), exposure=EXPOSURES[number])
        turned = camera.scan_from_camera(head_angle_towards(pose, np.array([5.5, 0.0, 2.5])))
        (photo,) = station_photos(scene, pose, camera, [turned], rng)
        photos.append(
            PlacedPhoto(str(number), str(number), photo.camera, pose * photo.scan_from_camera, lambda p=photo: p.image)
        )
    return np.concatenate(points), np.ascontiguousarray(np.concatenate(normals)), photos, np.concatenate(true)


@pytest.fixture(scope="module")
def coloured(rendered: tuple[np.ndarray, np.ndarray, list[PlacedPhoto], np.ndarray]) -> ColouredCloud:
    points, normals, photos, _ = rendered
    return coloured_cloud(points, normals, photos, ColouringOptions(), NoProgress())


def errors(cloud: ColouredCloud, true: np.ndarray) -> np.ndarray:
    """Give the differences from the true colours at unburnt points, after the common exposure is taken out."""
    used = cloud.coloured & (true.max(axis=1) < 240.0)
    got = cloud.colors[used].astype(float)
    return np.asarray(got * (got * true[used]).sum() / (got**2).sum() - true[used])


def test_colours_are_true_to_some_grey_levels(
    rendered: tuple[np.ndarray, np.ndarray, list[PlacedPhoto], np.ndarray], coloured: ColouredCloud
) -> None:
    off = errors(coloured, rendered[3])
    print(f"rms {np.sqrt((off**2).mean()):.2f} median {np.median(np.abs(off)):.2f} of {coloured.coloured.mean():.3f}")
    assert coloured.coloured.sum() > 10_000
    # a pixel of these small photos is 20 mm wide on the wall, and mixes colours at every edge
    assert np.sqrt((off**2).mean()) < 8.0
    assert np.median(np.abs(off)) < 2.0


def test_exposures_of_the_stations_are_told_apart(coloured: ColouredCloud) -> None:
    ratio = np.exp(coloured.balance.log_gains[0] - coloured.balance.log_gains[1])
    np.testing.assert_allclose(ratio, EXPOSURES[0] / EXPOSURES[1], rtol=0.03)


def test_photos_that_lie_where_they_are_said_to_are_not_called_turned(coloured: ColouredCloud) -> None:
    assert coloured.turns == []


@pytest.mark.parametrize("turn_mrad", [(0.0, 10.0, 0.0), (-8.0, 0.0, 6.0)])
def test_a_photo_turned_against_the_other_is_told_with_its_turn(
    rendered: tuple[np.ndarray, np.ndarray, list[PlacedPhoto], np.ndarray], turn_mrad: tuple[float, float, float]
) -> None:
    points, normals, photos, _ = rendered
    wrong = RigidTransform.from_rotation(Rotation.from_rotvec(1e-3 * np.array(turn_mrad)))
    turned = [photos[0], replace(photos[1], common_from_camera=photos[1].common_from_camera * wrong)]
    (found,) = coloured_cloud(points, normals, turned, ColouringOptions(), NoProgress()).turns
    # of two photos either may be the wrong one; both look the same way here, so that the turns are opposite
    sign = 1.0 if found.photos == (1,) else -1.0
    if found.photos == (1,):
        np.testing.assert_array_less(np.abs(1e3 * found.turn_rad - turn_mrad), 3.0 * 1e3 * found.turn_std_rad)
    assert sign * found.turn_rad @ turn_mrad > 0.8 * np.linalg.norm(found.turn_rad) * np.linalg.norm(turn_mrad)
    assert "cannot tell" in found.in_words(["a", "b"])


def test_what_stands_behind_is_hidden_and_a_floor_does_not_hide_itself() -> None:
    side = np.arange(-1.0, 1.0, 0.02)
    x, y = (each.ravel() for each in np.meshgrid(side, side))
    board = np.column_stack([0.5 * x, 0.5 * y, np.full(len(x), 2.0)])
    wall = np.column_stack([x, y, np.full(len(x), 4.0)])
    floor = np.column_stack([x, np.full(len(x), 1.0), 5.0 + 3.0 * y])
    points = np.concatenate([board, wall, floor])
    normals = np.concatenate([np.tile([0.0, 0.0, -1.0], (2 * len(x), 1)), np.tile([0.0, -1.0, 0.0], (len(x), 1))])
    image = np.zeros((200, 200, 3), dtype=np.uint8)
    photo = PlacedPhoto("p", "s", CAMERA, RigidTransform.identity(), lambda: image)
    view = view_of(photo, points, normals, ColouringOptions(border=0.0))
    shown = np.zeros(len(points), dtype=bool)
    shown[view.numbers] = True
    behind = np.abs(wall[:, :2]).max(axis=1) < 0.9
    assert shown[: len(x)].all()
    assert not shown[len(x) : 2 * len(x)][behind].any()
    # beyond, the wall hides the floor
    assert shown[2 * len(x) :][floor[:, 2] < 3.7].mean() > 0.95


def test_a_surface_seen_from_its_back_is_not_coloured() -> None:
    points = np.column_stack([np.random.default_rng(0).uniform(-0.5, 0.5, (100, 2)), np.full(100, 2.0)])
    image = np.zeros((200, 200, 3), dtype=np.uint8)
    photo = PlacedPhoto("p", "s", CAMERA, RigidTransform.identity(), lambda: image)
    away = np.tile([0.0, 0.0, 1.0], (100, 1))
    assert len(view_of(photo, points, away, ColouringOptions()).numbers) == 0
    assert len(view_of(replace(photo), points, -away, ColouringOptions()).numbers) == 100
