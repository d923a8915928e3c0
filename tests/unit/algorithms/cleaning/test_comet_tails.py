"""Comet tails of simulated beams are found, and good points stay."""

import numpy as np
import pytest

from algorithms.cleaning.comet_tails import comet_tails
from algorithms.errors import InvalidInputError
from algorithms.scans.open3d_loading import import_open3d
from algorithms.scans.scan import Scan
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scene import Scene
from algorithms.simulation.scenes import SCENES

NOISE_M = 0.002
SCANNER = VirtualScanner(rows=1000, columns=2400, range_noise_std_m=NOISE_M)
TAIL_STD, GOOD_STD = 6.0, 4.0
"""Farther than so many standard deviations off every surface a point hangs; nearer than so many it is good."""


def distances_m(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Give how far points of the world lie from the surfaces of a scene."""
    open3d = import_open3d()
    surfaces = open3d.t.geometry.RaycastingScene()
    surfaces.add_triangles(
        open3d.core.Tensor(scene.vertices.astype(np.float32)), open3d.core.Tensor(scene.triangles.astype(np.uint32))
    )
    return np.asarray(surfaces.compute_distance(open3d.core.Tensor(points.astype(np.float32))).numpy())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pipe_hall", "office", "house"])
def test_nineteen_of_twenty_tails_are_found_and_one_good_point_in_a_hundred_is_lost_at_most(name: str) -> None:
    scene = SCENES[name]()
    scan = scan_scene(scene, scene.stations[0], SCANNER, np.random.default_rng(1))
    off = distances_m(scene, scene.stations[0].apply(scan.points))
    found = comet_tails(scan)
    tails, good = off > TAIL_STD * NOISE_M, off < GOOD_STD * NOISE_M
    assert tails.sum() > 100
    assert (found & tails).sum() / tails.sum() >= 0.95
    assert (found & good).sum() / good.sum() <= 0.01


def test_a_scan_without_raster_is_refused_by_name() -> None:
    with pytest.raises(InvalidInputError, match=r"S7.*rows and columns"):
        comet_tails(Scan(np.zeros((3, 3)), np.zeros(3), name="S7", sensor_m=np.zeros(3)))
