"""The vertical of a scan that was levelled roughly, told by its own walls."""

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Vector3
from algorithms.features.scan_features import ScanFeatures

LARGEST_TILT_RAD = np.radians(5.0)
"""Planes within this of the vertical are taken for walls, those within it of the horizontal for floors."""
SPREADS_RAD = (0.05, 0.05, 0.02, 0.01, 0.006, 0.003, 0.003, 0.003)
"""Walls that lean by more than about this against most others count less and less, round by round."""
LEAST_ROOT_AREA_M = 3.0
"""Walls of two directions must have so much together: root of the area [m]."""


def levelling(features: ScanFeatures) -> Rotation:
    """Give the small rotation that makes the walls of a scan vertical; none where they do not tell.

    The vertical is the direction that walls stand along: the sum of w (n . u)^2 over their normals is made least, with
    weights of Cauchy so that a leaning wall does not tilt the scan.

    Parameters
    ----------
    features
        Of the scan, levelled to some degrees.
    """
    planes = features.planes
    walls = np.abs(planes.normals[:, 2]) < np.sin(LARGEST_TILT_RAD)
    normals, areas = planes.normals[walls], np.sqrt(planes.areas_m2[walls])
    up = np.array([0.0, 0.0, 1.0])
    if len(normals) < 2:
        return Rotation.identity()
    for spread in SPREADS_RAD:
        weights = areas / (1.0 + ((normals @ up) / spread) ** 2)
        scatter = (normals * weights[:, None]).T @ normals
        values, vectors = np.linalg.eigh(scatter)
        if values[1] < LEAST_ROOT_AREA_M or abs(vectors[2, 0]) < np.cos(LARGEST_TILT_RAD):
            return Rotation.identity()
        up = vectors[:, 0] * np.sign(vectors[2, 0])
    return _turn_to_z(up)


def _turn_to_z(up: Array) -> Rotation:
    across: Vector3 = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(across))
    return Rotation.from_rotvec(across * (np.arctan2(sine, float(up[2])) / sine if sine > 0.0 else 1.0))
