"""Speed from a photo of six million pixels and a scan to lines in space."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.photo_lines.photo_line_options import PhotoLineOptions
from algorithms.features.photo_lines.photo_lines import add_photo_lines
from algorithms.photos.station_photo import StationPhoto, mount_covariance
from algorithms.progress import NoProgress
from algorithms.simulation.rendering import station_photos
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.virtual_camera import VirtualCamera, head_angle_towards, scanner_camera
from tests.measures.processor_time import measured
from tests.scenes.photos.courtyard import COURTYARD, courtyard_photo, courtyard_scan

pytestmark = pytest.mark.benchmark
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
    image, camera, pose = courtyard_photo("cam0_station00.png")
    scale = float(np.sqrt(6e6 / (camera.width * camera.height)))
    width, height = round(camera.width * scale), round(camera.height * scale)
    x, y = width / camera.width, height / camera.height
    enlarged = replace(
        camera, width=width, height=height, fx=camera.fx * x, fy=camera.fy * y, cx=(camera.cx + 0.5) * x - 0.5,
        cy=(camera.cy + 0.5) * y - 0.5,
    )  # fmt: skip
    image = cv2.resize(image, (width, height), interpolation=cv2.INTER_CUBIC)
    photo = StationPhoto(image, enlarged, pose, MOUNT)
    assert seconds("courtyard", courtyard_scan(), photo) <= MOST_S
