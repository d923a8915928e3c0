"""A photo taken from a scanner's station, and how well its place there is known."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Matrix6
from algorithms.geometry.cameras import Camera


@dataclass(frozen=True, eq=False)
class StationPhoto:
    """A photo taken from the scanner's station."""

    image: UInt8[Array, "h w"] | UInt8[Array, "h w 3"]
    """(h, w) grey or (h, w, 3) RGB."""
    camera: Camera
    """Interior orientation."""
    scan_from_camera: RigidTransform
    """Pose of the camera in the scan's frame, full coordinates."""
    mount_covariance: Matrix6
    """Of that pose: rotation vector on the left of the scan axes [rad], translation [m]."""


def mount_covariance(rotation_std_rad: float, translation_std_m: float) -> Matrix6:
    """Give the covariance (6, 6) of a mount known equally well about and along all axes (MATH 2.5)."""
    return np.diag([rotation_std_rad**2] * 3 + [translation_std_m**2] * 3)
