"""Targets of a scan are measured in photos of the station, as well as their covariances say."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Generator
from algorithms.errors import InvalidInputError
from algorithms.geometry.camera_mounts import CameraAxes, scan_from_camera_with_axes
from algorithms.geometry.cameras import Camera
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.simulation.materials import PLASTER
from algorithms.simulation.parts import box
from algorithms.simulation.rendering import render_photo
from algorithms.simulation.scene import scene_from_parts
from algorithms.simulation.sun import Daylight
from algorithms.simulation.target_parts import checker_board, facing, plate
from algorithms.simulation.virtual_camera import VirtualCamera
from algorithms.targets.found import FoundTarget
from algorithms.targets.options import TargetKind
from algorithms.targets.photo_agreement import ImagePoint, NotSeen
from algorithms.targets.photo_points import find_in_photo
from algorithms.targets.photo_squares import SquareModel

CAMERA = Camera(320, 220, 1792.4, 1793.1, 162.3, 108.2, -0.104, 0.098, -0.021, 3e-4, -5e-4)
SCAN_FROM_CAMERA = scan_from_camera_with_axes(
    RigidTransform.from_components([0.05, 0.02, 0.2], Rotation.from_rotvec([0.01, 0.03, 0.02])),
    CameraAxes.FORWARD_LEFT_UP,
)
ORIGIN_M = np.array([1000.0, 2000.0, 100.0])
STD_M, BOARD_M, SQUARE_M = 3e-4, 0.15, 0.05
SUN = Daylight(azimuth_rad=3.1, elevation_rad=0.7)
CHI_SQUARE_2 = 13.8
"""Exceeded by one of a thousand."""


def _target(kind: TargetKind, centre: Array, rng: Generator, steepest_deg: float = 50.0) -> tuple[FoundTarget, list]:
    towards = -centre / np.linalg.norm(centre)
    side = np.cross(towards, rng.normal(size=3))
    incidence = np.deg2rad(rng.uniform(0.0, steepest_deg))
    normal = np.cos(incidence) * towards + np.sin(incidence) * side / np.linalg.norm(side)
    pose = facing(centre, normal, float(rng.uniform(0.0, np.pi)))
    board = kind is TargetKind.BOARD
    parts = checker_board(pose, BOARD_M) if board else [plate(pose, SQUARE_M, SQUARE_M)]
    seen, size = centre + rng.normal(0.0, STD_M, 3), BOARD_M if board else SQUARE_M
    found = FoundTarget(kind, seen, STD_M**2 * np.eye(3), 100, incidence, 0.0, 1.0, 0.5, 1.0, size, normal)
    return found, parts


def _photo(parts: Sequence, rng: Generator, mount: tuple[float, float]) -> StationPhoto:
    """Photograph parts before a wall; the mount is stated with a random error of the given standard deviations."""
    scene = scene_from_parts("targets", [box((9.5, -4.0, -4.0), (9.7, 4.0, 4.0), PLASTER), *parts], [])
    image = render_photo(scene, SCAN_FROM_CAMERA, VirtualCamera(camera=CAMERA), rng, SUN)
    stated = RigidTransform.from_components(
        np.asarray(SCAN_FROM_CAMERA.translation) + rng.normal(0.0, mount[1], 3) + ORIGIN_M,
        Rotation.from_rotvec(rng.normal(0.0, mount[0], 3)) * SCAN_FROM_CAMERA.rotation,
    )
    return StationPhoto(image, CAMERA, stated, mount_covariance(*mount))


def _scene(rng: Generator, mount: tuple[float, float] = (1e-3, 3e-3)) -> tuple[list[FoundTarget], Array, StationPhoto]:
    """Give four targets, their true image points (4, 2), and the photo."""
    places = np.array([[7.0, 0.35, 0.2], [7.2, -0.3, 0.22], [6.9, 0.3, -0.2], [7.1, -0.32, -0.2]])
    places += rng.uniform(-0.03, 0.03, places.shape)
    kinds = (TargetKind.BOARD, TargetKind.RETRO_SQUARE, TargetKind.RETRO_SQUARE, TargetKind.BOARD)
    made = [_target(kind, place, rng) for kind, place in zip(kinds, places, strict=True)]
    photo = _photo([part for _, parts in made for part in parts], rng, mount)
    return [target for target, _ in made], CAMERA.image_from_camera(SCAN_FROM_CAMERA.inv().apply(places)), photo


def test_boards_and_squares_are_found_in_their_windows_to_a_part_of_a_pixel() -> None:
    targets, truth, photo = _scene(np.random.default_rng(3))
    for answer, image in zip(find_in_photo(photo, targets, ORIGIN_M), truth, strict=True):
        assert isinstance(answer, ImagePoint)
        error = answer.image_px - image
        assert np.linalg.norm(error) < 0.15
        assert error @ np.linalg.solve(answer.covariance_px2, error) < CHI_SQUARE_2
        assert answer.statistic < CHI_SQUARE_2


def test_a_badly_known_mount_is_told_by_all_targets_together() -> None:
    # 18 px of standard deviation: windows hold each other's targets
    targets, truth, photo = _scene(np.random.default_rng(5), mount=(1e-2, 3e-3))
    found = [each for each in find_in_photo(photo, targets, ORIGIN_M) if isinstance(each, ImagePoint)]
    assert len(found) >= 3
    assert all(np.linalg.norm(each.image_px - truth[each.target]) < 0.2 for each in found)


def test_what_hides_a_target_is_not_taken_for_it() -> None:
    rng = np.random.default_rng(7)
    target, parts = _target(TargetKind.BOARD, np.array([7.0, 0.1, 0.0]), rng)
    before = plate(facing((6.0, 0.1, 0.0), (-1.0, 0.0, 0.0)), 0.25, 0.25)
    answer = find_in_photo(_photo([*parts, before], rng, (1e-3, 3e-3)), [target], ORIGIN_M)[0]
    assert isinstance(answer, NotSeen)
    assert "window" in answer.reason or "explains only" in answer.reason


def test_targets_outside_the_photo_or_round_or_too_small_are_not_looked_for() -> None:
    rng = np.random.default_rng(8)
    photo = _photo([], rng, (1e-3, 3e-3))
    beside, _ = _target(TargetKind.BOARD, np.array([7.0, 5.0, 0.0]), rng)
    behind, _ = _target(TargetKind.BOARD, np.array([-7.0, 0.0, 0.0]), rng)
    small, _ = _target(TargetKind.RETRO_SQUARE, np.array([20.0, 0.1, 0.1]), rng, 1.0)
    round_one = FoundTarget(TargetKind.SPHERE, np.array([7.0, 0.0, 0.0]), np.eye(3), 9, 0.0, 0.0, 1.0, 0.0, 1.0, 0.2)
    answers = find_in_photo(photo, [beside, behind, small, round_one], ORIGIN_M)
    assert all(isinstance(each, NotSeen) for each in answers)
    reasons = [each.reason for each in answers if isinstance(each, NotSeen)]
    assert reasons[:2] == ["", ""]
    assert "px wide" in reasons[2]
    assert "round" in reasons[3]


def test_a_photo_of_another_size_is_refused() -> None:
    photo = StationPhoto(np.zeros((10, 10), dtype=np.uint8), CAMERA, SCAN_FROM_CAMERA, mount_covariance(1e-3, 1e-3))
    with pytest.raises(InvalidInputError, match="10 by 10 pixels"):
        find_in_photo(photo, [], ORIGIN_M)


def test_the_derivatives_of_a_square_are_its_differences() -> None:
    rng = np.random.default_rng(2)
    places = rng.uniform(-0.04, 0.04, (60, 2))
    model = SquareModel(places, np.zeros(60), 0.05, np.array([0.002, 0.001, 0.3]), 0.003, 0.02)
    x = np.array([0.003, -0.002, np.log(0.004), 0.05, -0.03, 0.02, 0.4, 50.0, 5.0, -8.0, 150.0, 10.0, 20.0])
    steps = 1e-6 * np.eye(len(x))
    differences = [(model.brightness(x + s)[0] - model.brightness(x - s)[0]) / 2e-6 for s in steps]
    expected = np.stack(differences, axis=1)
    np.testing.assert_allclose(model.brightness(x)[1], expected, atol=1e-6 * float(np.abs(expected).max()))


@pytest.mark.slow
def test_image_points_scatter_as_their_covariances_say() -> None:
    squares: dict[TargetKind, list[float]] = {TargetKind.BOARD: [], TargetKind.RETRO_SQUARE: []}
    for seed in range(10):
        targets, truth, photo = _scene(np.random.default_rng(100 + seed))
        for answer in find_in_photo(photo, targets, ORIGIN_M):
            if isinstance(answer, ImagePoint):
                error = answer.image_px - truth[answer.target]
                square = float(error @ np.linalg.solve(answer.covariance_px2, error))
                squares[targets[answer.target].kind].append(square)
    # 2 +- 0.45 is one standard deviation of the mean of 20
    for kind, found in squares.items():
        assert len(found) >= 15, kind
        assert 1.0 < float(np.mean(found)) < 3.2, kind
