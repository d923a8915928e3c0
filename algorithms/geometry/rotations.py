"""Small building blocks of rotations: cross product matrices, small rotations, the best rotation between directions."""

import math

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Matrices3, Matrix3, Points, Scalars, Vector3


def cross_matrix(vector: Vector3) -> Matrix3:
    """Build S(v) with S(v) x = v × x.

    Parameters
    ----------
    vector
        (3,) vector v.

    Returns
    -------
    (3, 3) skew-symmetric matrix.
    """
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross_matrices(vectors: Points) -> Matrices3:
    """Build S(v) with S(v) x = v × x for each of n vectors.

    Parameters
    ----------
    vectors
        (n, 3) vectors.

    Returns
    -------
    (n, 3, 3) skew-symmetric matrices.
    """
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    matrices[:, 1, 0], matrices[:, 2, 0], matrices[:, 2, 1] = vectors[:, 2], -vectors[:, 1], vectors[:, 0]
    return matrices


def velocity_design(points: Points, directions: Points) -> Array:
    """Give the derivatives (n, 6) of displacements a + w x p along directions by (w, a), as of points to planes.

    Parameters
    ----------
    points, directions
        (n, 3) where, and along which direction; the points about the centre that (w, a) are told about.
    """
    return np.hstack([np.cross(points, directions), directions])


def rotation_matrix(pose: RigidTransform) -> Matrix3:
    """Give the (3, 3) rotation matrix of a pose; scipy checks its `rotation` anew, which takes 50 times as long."""
    return np.asarray(pose.as_matrix()[:3, :3])


def turn_between(first: RigidTransform, second: RigidTransform) -> float:
    """Give the angle between the rotations of two poses [rad], to within 1e-7: from its cosine."""
    trace = float(np.vdot(rotation_matrix(first), rotation_matrix(second)))
    return math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))


def rotation_between_directions(
    source_directions: Points, target_directions: Points, weights: Scalars | None = None
) -> Rotation:
    """Find the proper rotation that turns the source directions best onto the target directions.

    Minimises the weighted sum of squared differences (Kabsch; MATH 1.8). The signs of the directions must already
    agree. With directions of one axis only the answer is one of infinitely many.

    Parameters
    ----------
    source_directions
        (n, 3) unit directions in the source frame.
    target_directions
        (n, 3) unit directions in the target frame.
    weights
        (n,) non-negative weights; equal when left out.
    """
    weighted = target_directions if weights is None else target_directions * weights[:, None]
    left, _, right = np.linalg.svd(weighted.T @ source_directions)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return Rotation.from_matrix((left * signs) @ right)


def rotation_from_frames(source_frames: Array, target_frames: Array) -> Array:
    """Give the rotations that turn orthonormal source frames onto target frames.

    Parameters
    ----------
    source_frames, target_frames
        (..., 3, 3) orthonormal axes as columns, both of the same handedness.

    Returns
    -------
    (..., 3, 3) rotation matrices R with R source = target.
    """
    return np.asarray(target_frames @ np.swapaxes(source_frames, -1, -2))
