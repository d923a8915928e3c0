"""Poses of stations with their joint covariance, told in other frames (MATH 6.2, 6.7)."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array
from algorithms.geometry.rotations import cross_matrix


def relative_to(
    poses: Sequence[RigidTransform], covariance: Array, base: int
) -> tuple[tuple[RigidTransform, ...], Array]:
    """Tell all poses in the frame of one station, which then is without error (MATH 6.2, 6.7).

    Parameters
    ----------
    poses
        World from station.
    covariance
        (6 p, 6 p) of all of them.
    base
        Number of the station.
    """
    p = len(poses)
    back = poses[base].rotation.as_matrix().T
    jacobian = np.zeros((6 * p, 6 * p))
    own = slice(6 * base, 6 * base + 6)
    for k in range(p):
        rows = slice(6 * k, 6 * k + 6)
        if k == base:
            continue
        away = np.asarray(poses[k].translation) - np.asarray(poses[base].translation)
        jacobian[rows, rows] = np.kron(np.eye(2), back)
        jacobian[rows, own] = -np.kron(np.eye(2), back)
        jacobian[6 * k + 3 : 6 * k + 6, 6 * base : 6 * base + 3] = back @ cross_matrix(away)
    told = tuple(poses[base].inv() * pose for pose in poses)
    return told, jacobian @ covariance @ jacobian.T


def smallest_trace(poses: Sequence[RigidTransform], covariance: Array) -> Array:
    """Give the covariance (6 p, 6 p) of the same poses in the frame that makes its trace smallest (MATH 6.2).

    Parameters
    ----------
    poses
        World from station; at least two.
    covariance
        In any datum.
    """
    motions = np.zeros((6 * len(poses), 6))
    centre = np.mean([pose.translation for pose in poses], axis=0)
    for k, pose in enumerate(poses):
        motions[6 * k : 6 * k + 3, :3] = np.eye(3)
        motions[6 * k + 3 : 6 * k + 6, :3] = -cross_matrix(np.asarray(pose.translation) - centre)
        motions[6 * k + 3 : 6 * k + 6, 3:] = np.eye(3)
    left = np.eye(len(motions)) - motions @ np.linalg.solve(motions.T @ motions, motions.T)
    return np.asarray(left @ covariance @ left.T)
