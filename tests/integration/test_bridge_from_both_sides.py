"""A bridge that is itself again after half a turn, scanned upstream and downstream: the scans look the same."""

import numpy as np
import pytest

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.matching.coarse_registration import match_features
from algorithms.matching.options import MatchingOptions
from algorithms.progress import NoProgress
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import scan_scene
from tests.scenes.photos.photographed_stations import DOWNSTREAM, bare_bridge_scene

pytestmark = pytest.mark.slow

SCANNER = VirtualScanner(rows=500, columns=1200)


@pytest.mark.parametrize("second", ["opposite", "beyond"])
def test_the_mirrored_pose_of_a_bridge_is_never_the_only_one(second: str) -> None:
    scene = bare_bridge_scene()
    poses = (scene.stations[0], DOWNSTREAM[second])
    target, source = (
        extract_features(
            scan_scene(scene, pose, SCANNER, np.random.default_rng(k)),
            FeatureOptions(),
            progress=NoProgress(),
            rng=np.random.default_rng(0),
        )
        for k, pose in enumerate(poses)
    )
    found = match_features(target, source, MatchingOptions())
    truth = poses[0].inv() * poses[1]
    turn = np.degrees((found.target_from_source.rotation * truth.rotation.inv()).magnitude())
    assert turn < 1.0 or found.ambiguous, found
