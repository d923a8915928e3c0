"""Buildings that look like themselves elsewhere: the answer says so, instead of choosing."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from symmetric_pairs import SCANNER, symmetric_pair

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.matching.symmetries import poses_by_symmetry
from algorithms.progress import NoProgress
from algorithms.registration.base import PairStatus
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.symmetric_scenes import HALF_TURN, SYMMETRIC_SCENES, symmetric_room


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_a_symmetric_building_is_called_ambiguous_with_the_reason(name: str) -> None:
    pair = symmetric_pair(name, 1, 0)
    assert pair.status is PairStatus.AMBIGUOUS
    assert any("another pose" in reason or "different pose" in reason for reason in pair.reasons)


def test_the_scan_of_a_symmetric_room_proposes_the_half_turn() -> None:
    rng = np.random.default_rng(3)
    scene = symmetric_room(rng)
    scan = next(iter(simulate_stations(scene, scene.stations[:1], SCANNER, rng)))
    features = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=rng)
    found = poses_by_symmetry(features, features, RigidTransform.identity(), MatchingOptions())
    turn = scene.stations[0].inv() * HALF_TURN * scene.stations[0]
    centre = features.index.points.mean(axis=0)
    apart = np.linalg.norm(found.rotations @ centre + found.translations_m - turn.apply(centre), axis=1)
    turned = np.abs(found.rotations - turn.rotation.as_matrix()).max(axis=(1, 2))
    assert ((apart < 0.03) & (turned < 0.01)).any()
