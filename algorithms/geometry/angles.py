"""Rotation angles ω, φ, κ, their small changes and their covariance (MATH 1.1 to 1.4)."""

import numpy as np
from scipy.spatial.transform import Rotation

from algorithms.arrays import Matrix3, Vector3

GON_PER_RAD = 200.0 / np.pi
"""Gon in one radian: 400 gon = 2π rad."""

GIMBAL_LIMIT = 1e-6
"""Below this |cos φ| the angles ω and κ turn about the same axis and are not separable (MATH 1.3)."""


def rotation_from_angles(omega_rad: float, phi_rad: float, kappa_rad: float) -> Rotation:
    """Build R = Rx(ω) Ry(φ) Rz(κ), source to target.

    As moving axes: ω about x, then φ about the new y, then κ about the newest z (MATH 1.1).
    """
    return Rotation.from_euler("XYZ", [omega_rad, phi_rad, kappa_rad])


def angles_from_rotation(rotation: Rotation) -> Vector3:
    """Give (ω, φ, κ) of R = Rx(ω) Ry(φ) Rz(κ) in rad; ω and κ in (-π, π], φ in [-π/2, π/2].

    All three by atan2 (MATH 1.2), so that no quadrant is lost. Where |cos φ| < `GIMBAL_LIMIT` only ω ± κ is
    determined; κ is then set to 0 and ω carries the whole turn.
    """
    r = rotation.as_matrix()
    cos_phi = np.hypot(r[0, 0], r[0, 1])
    phi = np.arctan2(r[0, 2], cos_phi)
    if cos_phi < GIMBAL_LIMIT:
        return np.array([np.arctan2(r[2, 1], r[1, 1]), phi, 0.0])
    return np.array([np.arctan2(-r[1, 2], r[2, 2]), phi, np.arctan2(-r[0, 1], r[0, 0])])


def rotation_vector_rates(omega_rad: float, phi_rad: float) -> Matrix3:
    """Give W with w = W (dω, dφ, dκ), w the small rotation vector on the left in target axes (MATH 1.3).

    det W = cos φ.
    """
    so, co, sp, cp = np.sin(omega_rad), np.cos(omega_rad), np.sin(phi_rad), np.cos(phi_rad)
    return np.array([[1.0, 0.0, sp], [0.0, co, -so * cp], [0.0, so, co * cp]])


def angle_covariance(rotation: Rotation, rotation_covariance: Matrix3) -> Matrix3 | None:
    """Give the covariance of (ω, φ, κ) [rad²] from that of the rotation vector, C = W⁻¹ C_w W⁻ᵀ (MATH 1.4).

    Parameters
    ----------
    rotation
        Target from source.
    rotation_covariance
        (3, 3) covariance of the left rotation vector [rad²].

    Returns
    -------
    (3, 3) covariance, or None where |cos φ| < `GIMBAL_LIMIT`: ω and κ are not separable there.
    """
    omega, phi, _ = angles_from_rotation(rotation)
    if abs(np.cos(phi)) < GIMBAL_LIMIT:
        return None
    inverse = np.linalg.inv(rotation_vector_rates(omega, phi))
    return np.asarray(inverse @ rotation_covariance @ inverse.T)


def phi_variance(rotation: Rotation, rotation_covariance: Matrix3) -> float:
    """Give the variance of φ [rad²]; unlike ω and κ it exists in every attitude.

    The row of W⁻¹ for φ is (0, cos ω, sin ω), whatever φ is.
    """
    omega = angles_from_rotation(rotation)[0]
    row = np.array([0.0, np.cos(omega), np.sin(omega)])
    return float(row @ rotation_covariance @ row)
