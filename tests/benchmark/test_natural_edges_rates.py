"""How often errors of a mount are found from edges of rendered photos, and how honest the standard deviations are.

`TIELINE_NATURAL_EDGES` sets how many errors are planted in each scene (100). Run with -m benchmark -s for the figures.
"""

import os
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.calibration.edge_images import EdgePhoto, StationEdges, moved_mounts
from algorithms.calibration.edge_options import EdgeCalibrationOptions
from algorithms.calibration.natural_edges import mounts_from_edges
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.photos.detector import detect_edges
from algorithms.photos.options import EdgeOptions
from algorithms.progress import NoProgress
from algorithms.simulation.rendering import station_photos
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES
from algorithms.simulation.virtual_camera import VirtualCamera, scanner_camera

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]

PLANTED = int(os.environ.get("TIELINE_NATURAL_EDGES", "100"))
SCANNER = VirtualScanner(rows=500, columns=1200)
CAMERA = VirtualCamera(camera=scanner_camera(0.5))
SHARP = EdgeCalibrationOptions(rounding_std_m=0.0005)
"""Edges of virtual scenes are sharp."""


@cache
def photographed(name: str, number: int) -> tuple[StationEdges, list[EdgePhoto]]:
    """Scan a scene and take four photos around, with their true poses."""
    scene, rng = SCENES[name](), np.random.default_rng([7, number])
    pose = scene.stations[number]
    scan = scan_scene(scene, pose, SCANNER, rng)
    features = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    lines = features.lines[np.flatnonzero((features.lines.parents >= 0).all(axis=1))]
    poses = [CAMERA.scan_from_camera(turn) for turn in np.arange(4) * np.pi / 2.0]
    photos = []
    for photo in station_photos(scene, pose, CAMERA, poses, rng):
        segments = detect_edges(photo.image, photo.camera, EdgeOptions(), progress=NoProgress())
        place = photo.scan_from_camera
        reduced = RigidTransform.from_components(np.asarray(place.translation) - features.origin_m, place.rotation)
        photos.append(EdgePhoto(0, 0, segments, photo.camera, reduced))
    return StationEdges(lines, features.planes.covariances), photos


@pytest.mark.parametrize(("name", "numbers"), [("house", (0, 1)), ("street_square", (0, 1))])
@pytest.mark.parametrize("together", [False, True])
def test_two_mrad_and_five_mm_are_found_and_recovered(name: str, numbers: tuple[int, ...], together: bool) -> None:
    recorded = [photographed(name, number) for number in numbers]
    sets = [recorded] if together else [[each] for each in recorded]
    rng, found, within, false, total, squares = np.random.default_rng(3), 0, 0, 0, 0, []
    for each in sets:
        stations = [edges for edges, _ in each]
        true = [replace(photo, station=k) for k, (_, photos) in enumerate(each) for photo in photos]
        (clean,) = mounts_from_edges(stations, true, SHARP).mounts
        false += clean.wrong
        for _ in range(PLANTED // len(sets)):
            turn, shift = rng.normal(size=3), rng.normal(size=3)
            error = np.concatenate([0.002 * turn / np.linalg.norm(turn), 0.005 * shift / np.linalg.norm(shift)])
            back = moved_mounts(RigidTransform.identity(), error).inv()
            stated = [replace(photo, scan_from_camera=photo.scan_from_camera * back) for photo in true]
            (mount,) = mounts_from_edges(stations, stated, SHARP).mounts
            left = mount.error - error
            total += 1
            found += mount.wrong
            within += bool((np.abs(left) < 3.0 * mount.stds).all())
            squares.append(left @ np.linalg.solve(mount.covariance, left))
        stds, sizes = 1e3 * clean.stds, 1e3 * clean.detectable
        print(
            f"{name}: {clean.pair_counts.sum()} edges, std {stds[:3].max():.2f} mrad, {stds[3:].max():.1f} mm, "
            f"detectable alone {sizes[:3].max():.2f} mrad, {sizes[3:].max():.1f} mm"
        )
    print(f"{name}, together {together}: found {found}, within 3 std {within} of {total}, NEES {np.mean(squares):.1f}")
    assert false == 0
    assert found >= 0.95 * total
    assert within >= 0.95 * total
