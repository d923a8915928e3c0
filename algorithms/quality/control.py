"""Whether what fits in a pose controls itself: would the shift still be known were any one plane of it left out.

Every room corner has a floor and two walls, and every corner can be laid on every other: three planes determine a pose
and show nothing. Only what lies on surface beyond them says that it is the right one. That is the idea of controlled
observations (an error in one must show in the others, MATH 4.3) for whole walls instead of single points.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.rotations import rotation_matrix
from algorithms.scans.pose_scores import FINAL_POINTS
from algorithms.scans.surface_index import EvidenceLimits
from algorithms.scans.surface_matches import corresponding


def controlled_area_m2(
    target: ScanFeatures, source: ScanFeatures, target_from_source: RigidTransform, limits: EvidenceLimits
) -> float:
    """Give the least surface across any direction of shift that is left of what fits without any one plane [m2].

    What fits determines the shift through the sum of area times n n', with n the normals; its smallest eigenvalue is
    the area that stands across the worst determined direction. Each plane of either scan is left out in turn, with
    all that lies in its unbounded plane: two pieces of one wall do not control each other. O(points times planes).

    Parameters
    ----------
    target, source
        Features of the two scans.
    target_from_source
        Pose in the reduced frames [m].
    limits
        What lies on the other scan's surface, and in a plane.

    Returns
    -------
    The mean over both scans' surfaces [m2]; 0 where less than three planes fit.
    """
    turn = rotation_matrix(target_from_source)
    of_source, _ = corresponding(target_from_source, source.index, target.index, limits, FINAL_POINTS)
    of_target, _ = corresponding(target_from_source.inv(), target.index, source.index, limits, FINAL_POINTS)
    points = np.vstack([target_from_source.apply(source.index.points[of_source]), target.index.points[of_target]])
    normals = np.vstack([source.index.normals[of_source] @ turn.T, target.index.normals[of_target]])
    areas = np.repeat([0.5 * _area_per_point_m2(scan) for scan in (source, target)], [len(of_source), len(of_target)])
    moments = (areas[:, None, None] * normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)
    plane_normals = np.vstack([source.planes.normals @ turn.T, target.planes.normals])
    centroids = np.vstack([target_from_source.apply(source.planes.centroids), target.planes.centroids])
    offsets = np.einsum("ij,ij->i", plane_normals, centroids)
    inside = np.abs(points @ plane_normals.T - offsets) <= limits.max_distance_m
    left = moments.sum(axis=0) - np.vstack([inside.T.astype(np.float64) @ moments, np.zeros((1, 9))])
    return float(max(np.linalg.eigvalsh(left.reshape(-1, 3, 3))[:, 0].min(), 0.0))


def _area_per_point_m2(scan: ScanFeatures) -> float:
    """Give the surface that each of the first `FINAL_POINTS` points stands for, a square of their spacing."""
    index = scan.index
    return index.spacing_m**2 * max(len(index.points) / FINAL_POINTS, 1.0)
