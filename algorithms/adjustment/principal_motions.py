"""The independent motions of a pose, from the best to the worst determined (MATH 5.1)."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrix


@dataclass(frozen=True, eq=False)
class PrincipalMotion:
    """One eigenvector of the scaled, centred covariance."""

    text: str
    """Its larger part in words."""
    std_m: float
    """Standard deviation; turns as the shift they cause at the features' rms distance from the centroid [m]."""
    turn: Vector3
    """(3,) rotation vector times that distance, target axes; unit length together with `shift`."""
    shift: Vector3
    """(3,) shift of the centroid, target axes."""


def principal_motions(pose: PoseEstimate, centroid_m: Vector3, radius_m: float) -> tuple[PrincipalMotion, ...]:
    """Decompose the covariance in x' = (Lc w, dp) into independent motions, worst determined first (MATH 5.1).

    Motions that the data leave free are not among them: their number is the rank.

    Parameters
    ----------
    pose
        Pose with covariance and null space.
    centroid_m
        (3,) centroid p of the features in the target frame [m].
    radius_m
        Lc, rms distance of the features from the centroid [m].
    """
    to_centred = np.zeros((6, 6))
    to_centred[:3, :3] = radius_m * np.eye(3)
    to_centred[3:, :3] = -cross_matrix(centroid_m - pose.translation_m)
    to_centred[3:, 3:] = np.eye(3)
    covariance = to_centred @ pose.covariance @ to_centred.T
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    # The covariance is zero along what is free, which must not pass for well determined.
    free = pose.null_space.shape[1]
    return tuple(_motion(values[k], vectors[:, k]) for k in range(5, free - 1, -1))


def _motion(variance: float, vector: Array) -> PrincipalMotion:
    larger = vector[3:] if np.linalg.norm(vector[3:]) >= np.linalg.norm(vector[:3]) else vector[:3]
    signed = vector * np.sign(larger[np.argmax(np.abs(larger))])  # the sign has no meaning: one of the two is chosen
    turn, shift = signed[:3], signed[3:]
    return PrincipalMotion(_in_words(turn, shift), float(np.sqrt(max(variance, 0.0))), turn, shift)


def _in_words(turn: Vector3, shift: Vector3) -> str:
    shifts = np.linalg.norm(shift) >= np.linalg.norm(turn)
    vector = shift if shifts else turn
    x, y, z = (float(value) + 0.0 for value in np.round(vector / np.linalg.norm(vector), 3))
    if shifts:
        return f"translation along ({x:.3f}, {y:.3f}, {z:.3f}) of the target frame"
    return f"rotation about ({x:.3f}, {y:.3f}, {z:.3f}) through the centroid of the features"
