"""Small virtual scans in files, and the truth about them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.scans.scan import Scan
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from service.formats import writers

SCANNER = VirtualScanner(rows=250, columns=600)
"""Some 60 thousand points of a house: enough for a dozen of lines, read and searched in about a second."""


def simulate(scene_name: str, count: int = 2) -> Sequence[Scan]:
    """Scan a scene from its first stations."""
    scene = SCENES[scene_name]()
    return list(simulate_stations(scene, scene.stations[:count], SCANNER, np.random.default_rng(1)))


def write_scans(folder: Path, scans: Sequence[Scan]) -> Sequence[Path]:
    """Write one E57 file per scan, without poses."""
    paths = [folder / f"{scan.name}.e57" for scan in scans]
    for path, scan in zip(paths, scans, strict=True):
        writers.write_scans(path, [scan])
    return paths


def first_from_second(scene_name: str) -> RigidTransform:
    """Give the true pose of a scene's second station in the frame of its first."""
    stations = SCENES[scene_name]().stations
    return stations[0].inv() * stations[1]
