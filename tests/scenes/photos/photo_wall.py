"""A bright rectangle painted on a grey wall: scan, photo and the true lines of its sides."""

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.geometry.cameras import Camera
from algorithms.scans.scan import Scan
from tests.scenes.photos.photo_scenes import looking, panel, scan_of

CAMERA = Camera(width=640, height=480, fx=500.0, fy=501.0, cx=318.0, cy=243.0, k1=-0.05)
SCAN_FROM_CAMERA: RigidTransform = looking(yaw_rad=0.05)
CORNERS = np.array([[6.0, 1.9, -0.9], [6.0, -1.1, -1.0], [6.0, -1.2, 1.3], [6.0, 2.0, 1.1]])
"""Of the rectangle, in the scan frame [m]."""
FINER = 8
NOISE_M = 0.002


def wall_scan(seed: int = 1) -> Scan:
    wall = panel((6.0, -4.0, -3.0), (0.0, 8.0, 0.0), (0.0, 0.0, 6.0), 0.03, np.random.default_rng(seed), NOISE_M)
    return scan_of(wall)


def wall_photo(
    seed: int = 2, camera: Camera = CAMERA, scan_from_camera: RigidTransform = SCAN_FROM_CAMERA
) -> np.ndarray:
    """Each pixel is the mean over 8 by 8 samples; lines are drawn through many points because the lens bends them."""
    share = np.linspace(0.0, 1.0, 200, endpoint=False)[:, None]
    following = np.roll(CORNERS, -1, axis=0)
    outline = np.vstack([a + share * (b - a) for a, b in zip(CORNERS, following, strict=True)])
    pixels = camera.image_from_camera(scan_from_camera.inv().apply(outline))
    # cv2 draws the samples on the outline as well, which would make the rectangle half a sample larger all around
    along = np.roll(pixels, -1, axis=0) - np.roll(pixels, 1, axis=0)
    inwards = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    inwards *= np.sign(np.sum(inwards * (pixels.mean(axis=0) - pixels)))
    pixels = pixels + inwards * 0.5 / FINER
    # cv2 counts from the centre of the first sample; 4 more bits for parts of samples
    samples = np.rint(((pixels + 0.5) * FINER - 0.5) * 16).astype(np.int32)
    canvas = np.full((camera.height * FINER, camera.width * FINER), 70, dtype=np.uint8)
    cv2.fillPoly(canvas, [samples], 170, cv2.LINE_8, 4)
    grey = cv2.resize(canvas, (camera.width, camera.height), interpolation=cv2.INTER_AREA).astype(np.float64)
    noisy = cv2.GaussianBlur(grey, (0, 0), 0.7) + np.random.default_rng(seed).normal(0.0, 1.5, grey.shape)
    return np.repeat(np.rint(noisy).clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def true_sides() -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends (4, 3) of the rectangle's sides [m]."""
    return CORNERS, np.roll(CORNERS, -1, axis=0)


def nearest_side(anchor: np.ndarray, direction: np.ndarray) -> int:
    """Which side runs along a line: by the distance of its middle from the line, and by direction."""
    starts, ends = true_sides()
    towards = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    away = np.linalg.norm(np.cross(0.5 * (starts + ends) - anchor, direction), axis=1)
    return int(np.argmin(away + 10.0 * np.linalg.norm(np.cross(towards, direction), axis=1)))
