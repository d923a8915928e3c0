"""Speed from a photo of six million pixels and a scan to lines in space."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.photo_lines import add_photo_lines
from algorithms.geometry.cameras import Camera
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.progress import NoProgress
from algorithms.simulation.rendering import station_photos
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera
from service.formats import read_scan
from tests.measures.processor_time import measured

pytestmark = pytest.mark.benchmark
COURTYARD = Path(__file__).resolve().parents[3] / "shared" / "data" / "photo_hku_a"
MOST_S = 3.0
"""Processor time that all space lines of a photo may take: one core alone keeps to it."""
MOUNT = mount_covariance(1e-4, 1e-3)


def seconds(name, scan, photo):
    """Print wall and processor seconds from pixels to lines; give the processor's."""
    features = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    wall, processor, found = measured(
        lambda: add_photo_lines(features, scan, [photo], PhotoLineOptions(), count=1, progress=NoProgress())
    )
    height, width = photo.image.shape[:2]
    print(
        f"\n{name}: {width} by {height} pixels, {len(scan)} points, {found.photo_edges.segment_counts[0]} edges, "
        f"{found.photo_edges.projected_counts[0]} in space: {wall:.2f} s (processor {processor:.2f} s)"
    )
    return processor


def test_the_lines_of_a_photo_of_the_virtual_house_take_three_seconds_at_most():
    scene = SCENES["house_front"]()
    pose, rng = scene.stations[0], np.random.default_rng(1)
    (scan,) = simulate_stations(scene, [pose], VirtualScanner(rows=1000, columns=2400), rng)
    half = VirtualCamera(camera=scanner_camera(0.5))
    towards = half.scan_from_camera(head_angle_towards(pose, np.array([5.5, 0.0, 2.5])))
    (taken,) = station_photos(scene, pose, half, [towards], rng)
    camera = scanner_camera()
    image = cv2.resize(taken.image, (camera.width, camera.height), interpolation=cv2.INTER_CUBIC)
    assert seconds("house", scan, StationPhoto(image, camera, towards, MOUNT)) <= MOST_S


@pytest.mark.skipif(not COURTYARD.exists(), reason="real photos are not here: ../shared/data/photo_hku_a")
def test_the_lines_of_an_enlarged_photo_of_a_courtyard_take_three_seconds_at_most():
    scan = replace(read_scan(COURTYARD / "L1_station10.ply", "L1_station10.ply"), sensor_m=np.zeros(3))
    name = "cam0_station00.png"
    entry = json.loads((COURTYARD / "cameras.json").read_text())[name]
    world_from_scan = json.loads((COURTYARD / "poses.json").read_text())["L1_station10"]
    camera_from_world = RigidTransform.from_matrix(np.array(entry["T_cam_world_refined"]))
    pose = (camera_from_world * RigidTransform.from_matrix(np.array(world_from_scan))).inv()
    scale = float(np.sqrt(6e6 / (entry["width"] * entry["height"])))
    width, height = round(entry["width"] * scale), round(entry["height"] * scale)
    ratios = np.array([width / entry["width"], height / entry["height"]])
    K, (k1, k2, p1, p2, k3) = np.array(entry["K"]), entry["dist"]
    focal, centre = np.array([K[0, 0], K[1, 1]]) * ratios, (np.array([K[0, 2], K[1, 2]]) + 0.5) * ratios - 0.5
    camera = Camera(width, height, *focal, *centre, k1=k1, k2=k2, k3=k3, p1=p1, p2=p2)
    image = cv2.resize(cv2.imread(str(COURTYARD / name))[..., ::-1], (width, height), interpolation=cv2.INTER_CUBIC)
    assert seconds("courtyard", scan, StationPhoto(image, camera, pose, MOUNT)) <= MOST_S
