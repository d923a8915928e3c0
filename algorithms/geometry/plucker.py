"""Pluecker coordinates of lines with their covariances (MATH 1.5, 1.6, 2.1).

L = (d, q x d) with unit direction d and any point q of the line. (d, L0) and (-d, -L0) are the same line.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Matrices4, Matrix6, Points
from algorithms.geometry.lines import Lines
from algorithms.geometry.rotations import cross_matrices, cross_matrix


def plucker_coordinates(lines: Lines) -> Array:
    """Give (n, 6) Pluecker coordinates (d, c x d); the second half in metres."""
    return np.hstack([lines.directions, np.cross(lines.anchors, lines.directions)])


def plucker_jacobians(lines: Lines) -> Array:
    """Give J, (n, 6, 4): changes of the Pluecker coordinates from (a1, a2, b1, b2), J = [[E, 0], [S(c)E, -S(d)E]]."""
    jacobians = np.zeros((len(lines), 6, 4))
    jacobians[:, :3, :2] = lines.bases
    jacobians[:, 3:, :2] = cross_matrices(lines.anchors) @ lines.bases
    jacobians[:, 3:, 2:] = -cross_matrices(lines.directions) @ lines.bases
    return jacobians


def plucker_covariances(lines: Lines) -> Array:
    """Give (n, 6, 6) covariances J C4 Jᵀ of the Pluecker coordinates; of rank 4 by construction."""
    jacobians = plucker_jacobians(lines)
    return np.asarray(jacobians @ lines.covariances @ np.swapaxes(jacobians, 1, 2))


def line_covariances_from_plucker(lines: Lines, plucker_covariance: Array) -> Matrices4:
    """Give (n, 4, 4) covariances of (a1, a2, b1, b2) from (n, 6, 6) ones of the Pluecker coordinates.

    The way back of MATH 2.1: a = Eᵀ dLh, e = dL0 - S(c) E a, b1 = -E2.e, b2 = E1.e.
    """
    transposed = np.swapaxes(lines.bases, 1, 2)
    turned = np.stack([-lines.bases[:, :, 1], lines.bases[:, :, 0]], axis=1)
    back = np.zeros((len(lines), 4, 6))
    back[:, :2, :3] = transposed
    back[:, 2:, :3] = -turned @ cross_matrices(lines.anchors) @ lines.bases @ transposed
    back[:, 2:, 3:] = turned
    return np.asarray(back @ plucker_covariance @ np.swapaxes(back, 1, 2))


def feet_from_origin(plucker: Array) -> Points:
    """Give the points (n, 3) of the lines that are nearest to the frame's origin, d x L0 [m]."""
    return np.cross(plucker[:, :3], plucker[:, 3:])


def plucker_motion(target_from_source: RigidTransform) -> Matrix6:
    """Give H = [[R, 0], [S(t)R, R]], which moves Pluecker coordinates: L_target = H L_source (MATH 1.6)."""
    rotation = target_from_source.rotation.as_matrix()
    motion = np.zeros((6, 6))
    motion[:3, :3] = motion[3:, 3:] = rotation
    motion[3:, :3] = cross_matrix(np.asarray(target_from_source.translation)) @ rotation
    return motion
