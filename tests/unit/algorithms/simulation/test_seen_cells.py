"""What a scan saw is known in every direction in which it measured, however wide the steps of its grid are."""

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from algorithms.simulation.scenes import SCENES


@pytest.mark.parametrize(("rows", "columns"), [(160, 400), (300, 720)])
def test_nearly_all_directions_between_the_steps_of_a_grid_are_known(rows: int, columns: int) -> None:
    scene = SCENES["office"]()
    scan = scan_scene(scene, scene.stations[0], VirtualScanner(rows=rows, columns=columns), np.random.default_rng(1))
    seen = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)).seen
    assert seen is not None
    # above the windows and below the zenith, where everything comes back
    known = np.isfinite(seen.nearest_m[len(seen.nearest_m) // 10 : len(seen.nearest_m) // 3])
    assert known.mean() > 0.99
