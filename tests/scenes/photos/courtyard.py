"""A real courtyard (`photo_hku_a`): one scan with a noise of centimetres, and four photos."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.geometry.cameras import Camera
from algorithms.scans.scan import Scan
from service.formats import read_scan

COURTYARD = Path(__file__).resolve().parents[4] / "shared" / "data" / "photo_hku_a"
PHOTOS = ("cam0_station00.png", "cam1_station00.png", "cam0_station21.png", "cam1_station21.png")


def courtyard_scan() -> Scan:
    """Read the scan; its file holds the scanner's own frame."""
    name = "L1_station10.ply"
    return replace(read_scan(COURTYARD / name, name), sensor_m=np.zeros(3))


def courtyard_photo(name: str, which: str = "refined") -> tuple[Array, Camera, RigidTransform]:
    """Read a photo, its camera and scan_from_camera: as `published`, which is wrong by 0.4 degrees, or `refined`."""
    entry = json.loads((COURTYARD / "cameras.json").read_text())[name]
    K, (k1, k2, p1, p2, k3) = np.array(entry["K"]), entry["dist"]
    camera = Camera(
        entry["width"], entry["height"], K[0, 0], K[1, 1], K[0, 2], K[1, 2], k1=k1, k2=k2, k3=k3, p1=p1, p2=p2
    )
    camera_from_world = RigidTransform.from_matrix(np.array(entry[f"T_cam_world_{which}"]))
    world_from_scan = json.loads((COURTYARD / "poses.json").read_text())["L1_station10"]
    image = cv2.cvtColor(cv2.imread(str(COURTYARD / name)), cv2.COLOR_BGR2RGB)
    return image, camera, (camera_from_world * RigidTransform.from_matrix(np.array(world_from_scan))).inv()
