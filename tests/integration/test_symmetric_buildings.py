"""Buildings that look like themselves elsewhere: the answer says so, instead of choosing."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures, SurfaceSample, Symmetries
from algorithms.matching.options import MatchingOptions
from algorithms.matching.symmetries import poses_by_symmetry, with_symmetries
from algorithms.progress import NoProgress
from algorithms.registration.base import PairStatus
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.symmetric_scenes import HALF_TURN, SYMMETRIC_SCENES, symmetric_room
from tests.scenes.buildings.symmetric_pairs import SCANNER, symmetric_pair

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", list(SYMMETRIC_SCENES))
def test_a_symmetric_building_is_called_ambiguous_with_the_reason(name: str) -> None:
    pair = symmetric_pair(name, 1, 0)
    assert pair.status is PairStatus.AMBIGUOUS
    assert any("another pose" in reason or "different pose" in reason for reason in pair.reasons)


def test_what_only_one_instrument_saw_beside_a_wall_does_not_refute_the_half_turn_of_a_symmetric_room() -> None:
    assert symmetric_pair("symmetric_room", 930001, 0).status is PairStatus.AMBIGUOUS


@pytest.fixture(scope="module")
def room() -> tuple[ScanFeatures, RigidTransform]:
    """Give the features of a scan of a symmetric room, and the half turn in its frame."""
    rng = np.random.default_rng(3)
    scene = symmetric_room(rng)
    scan = next(iter(simulate_stations(scene, scene.stations[:1], SCANNER, rng)))
    features = extract_features(scan, FeatureOptions(), progress=NoProgress(), rng=rng)
    return features, scene.stations[0].inv() * HALF_TURN * scene.stations[0]


def test_the_scan_of_a_symmetric_room_proposes_the_half_turn(room: tuple[ScanFeatures, RigidTransform]) -> None:
    features, turn = room
    found = poses_by_symmetry(features, features, RigidTransform.identity(), MatchingOptions())
    centre = features.index.points.mean(axis=0)
    apart = np.linalg.norm(found.rotations @ centre + found.translations_m - turn.apply(centre), axis=1)
    turned = np.abs(found.rotations - turn.rotation.as_matrix()).max(axis=(1, 2))
    assert ((apart < 0.03) & (turned < 0.01)).any()


def test_symmetries_that_are_known_propose_the_same_poses(room: tuple[ScanFeatures, RigidTransform]) -> None:
    features, _ = room
    pose, options = RigidTransform.from_translation([1.0, 2.0, 3.0]), MatchingOptions()
    known = with_symmetries(features, options)
    sought, kept = (poses_by_symmetry(each, each, pose, options) for each in (features, known))
    assert len(sought) == len(kept) >= 2
    np.testing.assert_allclose(kept.rotations, sought.rotations, atol=1e-12)
    np.testing.assert_allclose(kept.translations_m, sought.translations_m, atol=1e-12)


def test_symmetries_that_were_sought_with_other_limits_do_not_count(room: tuple[ScanFeatures, RigidTransform]) -> None:
    features, _ = room
    none_found = Symmetries(np.zeros((0, 4, 4)), 0.02, 0.15)
    poses = poses_by_symmetry(
        replace(features, symmetries=none_found),
        features,
        RigidTransform.identity(),
        MatchingOptions(max_angle_rad=0.03),
    )
    assert len(poses) >= 2
    assert not len(
        poses_by_symmetry(
            replace(features, symmetries=none_found),
            replace(features, symmetries=none_found),
            RigidTransform.identity(),
            MatchingOptions(max_angle_rad=0.02),
        )
    )


def test_a_scan_without_surface_has_no_symmetries(room: tuple[ScanFeatures, RigidTransform]) -> None:
    features, _ = room
    surface = features.surface
    bare = SurfaceSample(surface.points[:0], surface.normals[:0], surface.plane_labels[:0], surface.voxel_size_m)
    symmetries = with_symmetries(replace(features, surface=bare), MatchingOptions()).symmetries
    assert symmetries is not None
    assert len(symmetries.motions) == 0


@pytest.mark.parametrize("seed", [2, 730001])
def test_what_stands_there_only_once_decides_and_the_answer_says_so(seed: int) -> None:
    pair = symmetric_pair("symmetric_room", seed, 4)
    assert pair.status is PairStatus.ACCEPTED
    assert pair.right
    assert any("m2 that fits here" in reason for reason in pair.reasons)
