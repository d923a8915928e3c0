"""The pose that surfaces alone would choose near another one, without what lies apart."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.polish import polished
from algorithms.scans.pose_scores import FINAL_POINTS, score_poses
from algorithms.scans.surface_index import EvidenceLimits, surface_index

NOISES, LEAST_GATE_M = 6.0, 0.02
"""Surfaces this many standard deviations of the noise apart, and at least so far, are not the same: 5 cm are a piece of
furniture that was moved, not noise."""
WIDEST_GATE_M = 0.05
"""With noise that asks for a wider gate nothing is gained over the search, and its pose stands."""
AS_GOOD = 0.99
"""Share of the other pose's fitting surface with which a pose fits as well."""


def surface_pose_near(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, rival: RigidTransform
) -> RigidTransform:
    """Fit the surfaces from a pose with a narrow gate, or give the rival where that lays more surface on surface.

    The search polishes its poses with a wide gate, so that a piece that was moved by centimetres between the scans
    bends them by millimetres. With a narrow gate such a piece takes no part; but a narrow gate alone would stay
    wherever it starts, so the pose must also explain as much surface within it as its rival does.

    Parameters
    ----------
    target, source
        Features of the two scans; their thinned surfaces are used.
    pose
        Pose in question, target from source, between the reduced frames.
    rival
        Best pose of the search.
    """
    gate = max(NOISES * max(target.noise_std_m, source.noise_std_m), LEAST_GATE_M)
    if gate > WIDEST_GATE_M:
        return rival
    indices = [
        surface_index(f.surface.points, f.surface.normals, f.surface.voxel_size_m, f.sensor_m) for f in (target, source)
    ]
    limits = EvidenceLimits(gate, np.radians(20.0), 2.5 * max(index.spacing_m for index in indices))
    rotations = np.array([p.rotation.as_matrix() for p in (pose, rival)])
    translations = np.array([p.translation for p in (pose, rival)], dtype=np.float64)
    scores = score_poses(rotations, translations, indices[0], indices[1], points=FINAL_POINTS, limits=limits)
    if scores.support[0] < AS_GOOD * scores.support[1]:
        return rival
    return polished(pose, indices[0], indices[1], distances_m=(gate, 0.6 * gate), points=FINAL_POINTS)
