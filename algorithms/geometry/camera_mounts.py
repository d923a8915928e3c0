"""Where a camera sits on the scanner, and which way its axes point."""

from enum import Enum

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.errors import InvalidInputError


class CameraAxes(Enum):
    """How the axes of a camera's frame are laid."""

    RIGHT_DOWN_FORWARD = "right-down-forward"
    """x right, y down, z forward: OpenCV, RIEGL's CMCS, and everything in `algorithms`."""
    RIGHT_UP_BACKWARD = "right-up-backward"
    """x right, y up, looking along -z: photogrammetry, E57 images, OpenGL."""
    FORWARD_LEFT_UP = "forward-left-up"
    """x forward, y left, z up: vehicles and robots."""


_COLUMNS = {
    CameraAxes.RIGHT_DOWN_FORWARD: ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    CameraAxes.RIGHT_UP_BACKWARD: ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    CameraAxes.FORWARD_LEFT_UP: ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),
}
"""The axes of each kind, as seen in right-down-forward."""


def camera_from_axes(axes: CameraAxes) -> RigidTransform:
    """Give the rotation from a camera frame laid in another way to `camera` (x right, y down, z forward)."""
    matrix = np.array(_COLUMNS[axes], dtype=np.float64).T
    return RigidTransform.from_rotation(Rotation.from_matrix(matrix))


def scan_from_camera_with_axes(scan_from_other: RigidTransform, axes: CameraAxes) -> RigidTransform:
    """Give `scan_from_camera` from the pose of the same camera whose frame is laid in another way."""
    return scan_from_other * camera_from_axes(axes).inv()


def scan_from_mounted_camera(
    mount: RigidTransform, cop_rad: float, axes: CameraAxes = CameraAxes.RIGHT_DOWN_FORWARD
) -> RigidTransform:
    """Chain the pose of a camera that turns with the scanner's head: M_COP M_mount⁻¹.

    Parameters
    ----------
    mount
        M_mount, constant: camera from scan at head angle 0.
    cop_rad
        Angle of the head when the photo was taken, about the scanner's z axis; M_COP = Rz(cop_rad).
    axes
        How the frame that M_mount leads to is laid.

    Raises
    ------
    InvalidInputError
        When the angle is not a finite number.

    Notes
    -----
    Eq. (2) of A. Ullrich, R. Schwarz, H. Kager, Multistationsausgleichung für ein Laserscanner-System mit aufgesetzter
    Kamera: X_GLCS = M_POP M_SOP M_COP M_mount⁻¹ X_CMCS.
    """
    if not np.isfinite(cop_rad):
        raise InvalidInputError("head angle of the photo", f"{cop_rad}", "a finite angle in radians")
    head = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, cop_rad]))
    return scan_from_camera_with_axes(head * mount.inv(), axes)
