"""Motions from pairs of points: Horn's closed form, and the helical motion of a velocity field.

M. Hofer and H. Pottmann, "Orientierung von Laserscanner-Punktwolken" (2004), equations 1 to 14 and 44 to 47. Misprints
are corrected: r = s_y - R s_x in (4), the minus sign on the right of (13).
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Points, Scalars, Vector3

SMALL_TURN = 1e-12
"""Velocity fields that turn by less are translations."""


def best_rotation(target: Points, source: Points, weights: Scalars) -> Rotation:
    """Give the rotation that lays vectors on vectors: the quaternion's eigenvalue problem (lemma 2; Horn 1987).

    Parameters
    ----------
    target, source
        (n, 3) corresponding vectors, such as centred points or normals.
    weights
        (n,) weights.
    """
    moments = (source * weights[:, None]).T @ target
    antisymmetric = moments[1, 2] - moments[2, 1], moments[2, 0] - moments[0, 2], moments[0, 1] - moments[1, 0]
    trace = float(np.trace(moments))
    matrix = np.empty((4, 4))
    matrix[0, 0] = trace
    matrix[0, 1:] = matrix[1:, 0] = antisymmetric
    matrix[1:, 1:] = moments + moments.T - trace * np.eye(3)
    w, x, y, z = np.linalg.eigh(matrix)[1][:, -1]
    return Rotation.from_quat([x, y, z, w])


def best_motion(target: Points, source: Points, weights: Scalars) -> RigidTransform:
    """Give the motion that lays points on points: the rotation about the centres, and centre on centre (lemma 1).

    Parameters
    ----------
    target, source
        (n, 3) corresponding points [m], n >= 3.
    weights
        (n,) weights.
    """
    centres = [weights @ points / weights.sum() for points in (target, source)]
    rotation = best_rotation(target - centres[0], source - centres[1], weights)
    return RigidTransform.from_components(centres[0] - rotation.apply(centres[1]), rotation)


def helical_motion(turn: Vector3, shift: Vector3) -> RigidTransform:
    """Replace the affine displacement x + c_ + c x x by the Euclidean one about the same axis (equation 14).

    With the instantaneous screw g = c/|c|, pitch p = c.c_/c^2 and angle atan |c|: turned about the axis, and moved
    along it by pitch times angle.

    Parameters
    ----------
    turn, shift
        (3,) c and c_ of the velocity field.
    """
    speed = float(np.linalg.norm(turn))
    if speed < SMALL_TURN:
        return RigidTransform.from_translation(shift)
    axis = turn / speed
    pitch = float(turn @ shift) / speed**2
    point = np.cross(turn, shift) / speed**2
    angle = float(np.arctan(speed))
    rotation = Rotation.from_rotvec(angle * axis)
    return RigidTransform.from_components(point - rotation.apply(point) + pitch * angle * axis, rotation)
