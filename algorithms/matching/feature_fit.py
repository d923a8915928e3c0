"""Improve a pose by laying lines on lines and planes on planes: on a flat facade only its edges tell the place."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.correspondences import corresponding_lines, corresponding_planes
from algorithms.matching.polish import SurfaceGaps, point_to_plane_step

GATES = ((0.035, 0.15), (0.02, 0.08), (0.02, 0.05), (0.02, 0.05))
"""Largest angle [rad] and distance [m] of corresponding features in each round."""
DOUBTFUL_SHARE = 0.3
"""Features this share of the gate apart count half."""


def feature_pose_near(target: ScanFeatures, source: ScanFeatures, pose: RigidTransform) -> RigidTransform:
    """Fit lines and planes of two scans from a pose that is good to a decimetre; freedoms they leave open stay.

    A quick fit to compare poses by, without covariances: the adjustment comes later.

    Parameters
    ----------
    target, source
        Features of the two scans.
    pose
        Start, target from source, between the reduced frames.
    """
    for max_angle_rad, max_distance_m in GATES:
        limits = {"max_angle_rad": max_angle_rad, "max_distance_m": max_distance_m}
        lines = corresponding_lines(target, source, pose, **limits)
        planes = corresponding_planes(target, source, pose, **limits)
        if len(lines) + len(planes) == 0:
            return pose
        ours, theirs = target.lines[lines[:, 0]], source.lines[lines[:, 1]]
        ends = pose.apply(np.concatenate(theirs.end_points)) if len(lines) else np.empty((0, 3))
        centroids = source.planes.centroids[planes[:, 1]]
        centroids = pose.apply(centroids) if len(planes) else centroids
        # each end of a line has a gap across it in two directions, each plane one along its normal
        positions = np.concatenate([ends, ends, centroids])
        normals = np.concatenate(
            [np.tile(ours.bases[:, :, 0], (2, 1)), np.tile(ours.bases[:, :, 1], (2, 1)),
             target.planes.normals[planes[:, 0]]]
        )  # fmt: skip
        goals = np.concatenate([np.tile(ours.anchors, (4, 1)), target.planes.centroids[planes[:, 0]]])
        gaps = np.einsum("ij,ij->i", goals - positions, normals)
        found = SurfaceGaps(positions, normals, gaps, np.ones(len(gaps)))
        pose = point_to_plane_step(found, DOUBTFUL_SHARE * max_distance_m) * pose
    return pose


def common_features(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, *, max_angle_rad: float, max_distance_m: float
) -> int:
    """Count the lines and planes that lie on each other in a pose.

    Parameters
    ----------
    target, source
        Features of the two scans.
    pose
        Target from source, between the reduced frames.
    max_angle_rad, max_distance_m
        Largest angle and distance of corresponding features.
    """
    limits = {"max_angle_rad": max_angle_rad, "max_distance_m": max_distance_m}
    lines = corresponding_lines(target, source, pose, **limits)
    return len(lines) + len(corresponding_planes(target, source, pose, **limits))
