"""Real scans, each first moved by a random rigid motion, find each other without a first guess."""

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.coarse_registration import CoarseRegistration, match_features
from algorithms.matching.options import MatchingOptions
from algorithms.progress import NoProgress
from algorithms.quality.acceptance import AcceptanceStatus, Verdict, judge
from algorithms.quality.overlap import verify_pose
from algorithms.scans.scan import Scan
from service.formats import read_scan

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir() and "CI" not in os.environ, reason=f"the measured scans are not at {DATA}"),
]

PAIRS = [
    ("lpm_apartment", "cloud_0", "cloud_1"),
    ("garage_a", "scan002", "scan003"),
    ("eth_facade", "s2", "s3"),
    ("hall_a", "full040", "full050"),
]
STRANGERS = [
    (("garage_a", "scan002"), ("eth_facade", "s2")),
    (("lpm_apartment", "cloud_0"), ("hall_a", "full040")),
    (("eth_facade", "s3"), ("garage_a", "scan003")),
]


@cache
def _features(folder: str, name: str) -> tuple[ScanFeatures, RigidTransform]:
    """Features of a scan moved by a random motion, and the common frame from the moved scan."""
    scan = read_scan(DATA / folder / f"{name}.ply", f"{name}.ply")
    seed = sum(map(ord, folder + name))
    rng = np.random.default_rng(seed)
    motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=seed))
    moved = Scan(np.ascontiguousarray(motion.apply(scan.points + scan.origin_m)), origin_m=np.zeros(3), name=name)
    features = extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0))
    poses = json.loads((DATA / folder / "poses.json").read_text())
    return features, RigidTransform.from_matrix(np.array(poses[name])) * motion.inv()


def _judged(target: ScanFeatures, source: ScanFeatures) -> tuple[CoarseRegistration, Verdict]:
    coarse = match_features(target, source, MatchingOptions())
    verdict = judge(
        verify_pose(target, source, coarse.target_from_source),
        runner_up_score=coarse.runner_up_score,
        supporters=coarse.support,
        runner_up_supporters=coarse.runner_up_support,
        lone_spotless=coarse.lone_spotless,
    )
    return coarse, verdict


@pytest.mark.parametrize(("folder", "target", "source"), PAIRS)
def test_neighbours_are_accepted_near_the_reference_pose(folder: str, target: str, source: str) -> None:
    (ours, world_from_ours), (theirs, world_from_theirs) = _features(folder, target), _features(folder, source)
    coarse, verdict = _judged(ours, theirs)
    truth = world_from_ours.inv() * world_from_theirs
    centre = theirs.surface.points.mean(axis=0)
    turn = np.degrees((coarse.target_from_source.rotation.inv() * truth.rotation).magnitude())
    shift = np.linalg.norm(coarse.target_from_source.apply(centre) - truth.apply(centre))
    assert verdict.status is AcceptanceStatus.ACCEPTED
    # What the fine adjustment needs to find correspondences.
    assert turn < 1.0
    assert shift < 0.1


@pytest.mark.parametrize(("target", "source"), STRANGERS)
def test_scans_of_different_places_are_never_accepted(target: tuple[str, str], source: tuple[str, str]) -> None:
    ours, theirs = _features(*target)[0], _features(*source)[0]
    try:
        _, verdict = _judged(ours, theirs)
    except TooFewCorrespondencesError:
        return
    assert verdict.status is not AcceptanceStatus.ACCEPTED
