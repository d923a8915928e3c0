"""Small virtual photos taken from the stations of a scene, as requests name them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from algorithms.simulation.rendering import station_photos
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera
from service.formats.photo import camera_document

CAMERA = VirtualCamera(camera=scanner_camera(0.25))
"""752 by 500 pixels: rendered in some seconds."""


def take_photos(
    folder: Path, scene_name: str, towards_m: Sequence[float], count: int = 2
) -> Sequence[tuple[Path, Mapping[str, Any]]]:
    """Take one photo from each of the first stations; give the file, and camera and pose as JSON."""
    scene = SCENES[scene_name]()
    taken = []
    for number, pose in enumerate(scene.stations[:count]):
        cop_rad = head_angle_towards(pose, np.array(towards_m))
        rng = np.random.default_rng(number)
        (photo,) = station_photos(scene, pose, CAMERA, [CAMERA.scan_from_camera(cop_rad)], rng)
        path = folder / f"{scene_name}-{number + 1}.png"
        if not cv2.imwrite(str(path), photo.image[..., ::-1]):
            raise OSError(path)
        pose_rows = photo.scan_from_camera.as_matrix().tolist()
        taken.append((path, {"camera": camera_document(photo.camera), "scan_from_camera": pose_rows}))
    return taken
