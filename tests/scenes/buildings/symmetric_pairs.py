"""Pairs of stations in buildings that look like themselves elsewhere, through extraction and registration."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.features.extraction import extract_features
from algorithms.features.options import FeatureOptions
from algorithms.progress import NoProgress
from algorithms.registration import DEFAULT_METHOD
from algorithms.registration.base import PairStatus, RegistrationProblem
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.symmetric_scenes import SYMMETRIC_SCENES

SCANNER = VirtualScanner(rows=300, columns=720)
ODDITIES = (0, 1, 2, 4)
"""Pieces of furniture that break the symmetry."""
TOLERANCE_RAD, TOLERANCE_M = np.radians(0.3), 0.05
"""A pose farther from the truth than this is another one; the symmetries turn by half a circle or shift by metres."""


@dataclass(frozen=True)
class SymmetricPair:
    """What came of one pair."""

    scene: str
    seed: int
    oddities: int
    status: PairStatus
    right: bool
    """Whether the pose is the true one; False where there is none."""
    reasons: tuple[str, ...]

    @property
    def wrong_and_accepted(self):
        return self.status.in_place and not self.right


def symmetric_pair(name, seed, oddities):
    """Scan a scene from both its stations, move each scan at random, and register them."""
    rng = np.random.default_rng([seed, oddities, len(name)])
    scene = SYMMETRIC_SCENES[name](rng, oddities)
    features, poses = [], []
    for station, scan in zip(scene.stations, simulate_stations(scene, scene.stations, SCANNER, rng), strict=True):
        motion = RigidTransform.from_components(rng.uniform(-30.0, 30.0, 3), Rotation.random(random_state=rng))
        sensor = np.zeros(3) if scan.sensor_m is None else scan.sensor_m
        points = np.ascontiguousarray(motion.apply(scan.points))
        moved = replace(scan, points=points, sensor_m=motion.apply(sensor), grid=None)
        features.append(extract_features(moved, FeatureOptions(), progress=NoProgress(), rng=np.random.default_rng(0)))
        poses.append(station * motion.inv())
    result = DEFAULT_METHOD().register(RegistrationProblem(features[0], features[1]), progress=NoProgress())
    right = False
    answer = result.final or result.fine
    if answer is not None:
        pose, truth = answer.pose.target_from_source, poses[0].inv() * poses[1]
        centre = features[1].surface.points.mean(axis=0) + features[1].origin_m
        turn = (pose.rotation * truth.rotation.inv()).magnitude()
        right = turn < TOLERANCE_RAD and np.linalg.norm(pose.apply(centre) - truth.apply(centre)) < TOLERANCE_M
    return SymmetricPair(name, seed, oddities, result.status, bool(right), result.reasons)
