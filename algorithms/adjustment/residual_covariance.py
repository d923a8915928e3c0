"""What the noise of the lines makes of any estimator's pose, errors of shared planes included (MATH 2.4, 3.1).

Every estimator that is exact for error-free lines is, to first order, linear in the four residuals of each pair of
lines (two tilts, two offsets): dx = K r. Its true covariance is K C Kᵀ with the covariance C of those residuals.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.problem import SourcePlaneCovariances, TargetPlaneCovariances
from algorithms.arrays import Array, IndexPairs, Matrices3, Matrix
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import Lines


def residual_covariance(
    target: Lines,
    source: Lines,
    pairs: IndexPairs,
    target_from_source: RigidTransform,
    *,
    target_plane_covariances: TargetPlaneCovariances | None = None,
    source_plane_covariances: SourcePlaneCovariances | None = None,
) -> Matrix:
    """Give the joint covariance (4n, 4n) of the residuals of `LineLine`: C = C_target + J C_source Jᵀ.

    Parameters
    ----------
    target, source
        Lines of both scans.
    pairs
        (n, 2) numbers of target line and source line.
    target_from_source
        Pose at which the residuals are taken.
    target_plane_covariances, source_plane_covariances
        (p, 3, 3) covariances of the planes that `Lines.parents` counts; left out, lines count as independent.

    Raises
    ------
    InvalidInputError
        When the covariance of a plane is not positive definite.
    """
    derivatives = LineLine(target, source, pairs).linearised(target_from_source).source_jacobians
    n = len(pairs)
    of_source = joint_line_covariance(source[pairs[:, 1]], source_plane_covariances).reshape(n, 4, n, 4)
    moved = np.einsum("iab,ibjd,jcd->iajc", derivatives, of_source, derivatives, optimize=True)
    of_target = joint_line_covariance(target[pairs[:, 0]], target_plane_covariances)
    return np.asarray(of_target + moved.reshape(4 * n, 4 * n))


def joint_line_covariance(lines: Lines, plane_covariances: Matrices3 | None) -> Matrix:
    """Give the covariance (4n, 4n) of the error parameters (a1, a2, b1, b2) of all lines together.

    Intersections of planes take theirs from the planes, G Σ Gᵀ, and are correlated where they share one; other lines
    are independent.

    Parameters
    ----------
    lines
        n lines.
    plane_covariances
        (p, 3, 3) covariances of the planes' (a1, a2, b); None treats all lines as independent.

    Raises
    ------
    InvalidInputError
        When the covariance of a plane is not positive definite.
    """
    n = len(lines)
    own = lines.covariances
    through = np.zeros((n, 4, 0))
    if plane_covariances is not None:
        shared = (lines.parents >= 0).all(axis=1) & (lines.parent_jacobians != 0.0).any(axis=(1, 2))
        own = np.where(shared[:, None, None], 0.0, own)
        through = _through_planes(lines, np.flatnonzero(shared), plane_covariances)
    joint = np.einsum("iak,jbk->iajb", through, through, optimize=True)
    every = np.arange(n)
    joint[every, :, every, :] += own
    return np.asarray(joint.reshape(4 * n, 4 * n))


def _through_planes(lines: Lines, which: Array, plane_covariances: Matrices3) -> Array:
    """Give F, (n, 4, 3p), whose F Fᵀ is the covariance that comes through the planes."""
    try:
        roots = np.linalg.cholesky(plane_covariances)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError("covariance of a plane", "it is not positive definite") from error
    factors = np.zeros((len(lines), 4, len(plane_covariances), 3))
    for side in (0, 1):
        planes = lines.parents[which, side]
        factors[which, :, planes, :] += lines.parent_jacobians[which][:, :, 3 * side : 3 * side + 3] @ roots[planes]
    return np.asarray(factors.reshape(len(lines), 4, -1))
