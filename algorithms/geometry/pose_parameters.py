"""The six transformation parameters ω, φ, κ, tx, ty, tz of a pose, their small changes and their covariance."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Matrix6, Vector3
from algorithms.geometry.angles import GIMBAL_LIMIT, angles_from_rotation, rotation_vector_rates
from algorithms.geometry.poses import UNDETERMINED_SHARE, PoseEstimate

PARAMETERS = ("omega", "phi", "kappa", "tx", "ty", "tz")
"""Order of everything here; angles in rad, shifts in m."""

STRONG_CORRELATION = 0.9
"""Above this two parameters are named as hardly separable (MATH 7)."""


@dataclass(frozen=True, eq=False)
class PoseParameters:
    """The six parameters of a pose and their covariance."""

    values: Float64[Array, "6"]
    """ω, φ, κ [rad] and tx, ty, tz [m]."""
    covariance: Matrix6
    """(6, 6) covariance; rows and columns of what is not determined are zero."""
    determined: Bool[Array, "6"]
    """False for parameters that the geometry leaves free, and for ω and κ where they are not separable."""
    free: Bool[Array, "6"]
    """True for parameters that a free motion changes: their values mean nothing."""

    def correlations_above(self, limit: float) -> list[tuple[int, int, float]]:
        """List pairs of determined parameters whose correlation exceeds the limit in amount, largest first (MATH 7)."""
        std = np.sqrt(np.diag(self.covariance))
        known = np.flatnonzero(self.determined & (std > 0.0))
        found = []
        for place, i in enumerate(known):
            for j in known[place + 1 :]:
                correlation = float(self.covariance[i, j] / (std[i] * std[j]))
                if abs(correlation) > limit:
                    found.append((int(i), int(j), correlation))
        return sorted(found, key=lambda entry: -abs(entry[2]))


def parameter_rates(rotation: Rotation) -> tuple[Matrix6, Bool[Array, "6"]]:
    """Give how the parameters answer to (rotation vector on the left, translation): blkdiag(W⁻¹, I) (MATH 1.3, 1.4).

    Parameters
    ----------
    rotation
        Target from source.

    Returns
    -------
    rates
        (6, 6) derivatives; zero rows where a parameter is not separable.
    separable
        (6,) False for ω and κ where |cos φ| < `GIMBAL_LIMIT`; φ is separable in every attitude.
    """
    omega, phi, _ = angles_from_rotation(rotation)
    rates, separable = np.eye(6), np.ones(6, dtype=bool)
    if abs(np.cos(phi)) < GIMBAL_LIMIT:
        rates[:3, :3] = 0.0
        rates[1, :3] = [0.0, np.cos(omega), np.sin(omega)]
        separable[[0, 2]] = False
    else:
        rates[:3, :3] = np.linalg.inv(rotation_vector_rates(omega, phi))
    return rates, separable


def pose_parameters(pose: PoseEstimate) -> PoseParameters:
    """Read a pose as its six parameters: C = J C_pose Jᵀ with J = blkdiag(W⁻¹, I) (MATH 1.4)."""
    rates, separable = parameter_rates(pose.rotation)
    moved = np.abs(rates @ pose.null_space) > UNDETERMINED_SHARE
    free = np.asarray(moved.any(axis=1))
    determined = separable & ~free
    covariance = rates @ pose.covariance @ rates.T
    return PoseParameters(
        values=np.concatenate([pose.omega_phi_kappa_rad, pose.translation_m]),
        covariance=np.where(np.outer(determined, determined), covariance, 0.0),
        determined=determined,
        free=free,
    )


def shift_of_origin(turns: Float64[Array, "n 3"], shifts: Float64[Array, "n 3"], levers: Vector3) -> Array:
    """Carry small motions from one reference point to another: dp = dt + w × lever (MATH 1.4), (n, 3) [m].

    Parameters
    ----------
    turns, shifts
        (n, 3) small rotation vectors [rad], and shifts of the first point [m].
    levers
        (3,) from the first point to the other [m].
    """
    return np.asarray(shifts + np.cross(turns, levers))


def effects_on_parameters(
    motions: Float64[Array, "n 6"], pose: RigidTransform, centroid_m: Vector3
) -> tuple[Float64[Array, "n 6"], Bool[Array, "6"]]:
    """Give what small motions, told at a point of the target frame, change in the six parameters (MATH 1.3, 4.3).

    Parameters
    ----------
    motions
        (n, 6) rotation vectors on the left [rad] and shifts of the point [m].
    pose
        Target from source, in the frames whose parameters are wanted.
    centroid_m
        (3,) the point [m].

    Returns
    -------
    effects
        (n, 6) changes of ω, φ, κ [rad] and tx, ty, tz [m].
    separable
        (6,) as `parameter_rates`.
    """
    rates, separable = parameter_rates(pose.rotation)
    turns = motions[:, :3]
    shifts = shift_of_origin(turns, motions[:, 3:], np.asarray(pose.translation) - centroid_m)
    return np.hstack([turns, shifts]) @ rates.T, separable


def pose_with_parameter_std(pose: RigidTransform, std: Float64[Array, "6"]) -> PoseEstimate:
    """Give a pose the covariance that independent standard deviations of its six parameters stand for (MATH 1.3).

    C = blkdiag(W, I) diag(std²) blkdiag(W, I)ᵀ.

    Parameters
    ----------
    pose
        Target from source.
    std
        (6,) of ω, φ, κ [rad] and tx, ty, tz [m].
    """
    omega, phi, _ = angles_from_rotation(pose.rotation)
    jacobian = np.eye(6)
    jacobian[:3, :3] = rotation_vector_rates(omega, phi)
    return PoseEstimate(pose, jacobian @ np.diag(std**2) @ jacobian.T)
