"""What the noise of the lines makes of any estimator's pose, errors that lines share included (MATH 2.4, 2.5, 3.1).

Every estimator that is exact for error-free lines is, to first order, linear in the four residuals of each pair of
lines (two tilts, two offsets): dx = K r. Its true covariance is K C Kᵀ with the covariance C of those residuals, which
the rigorous adjustment uses too.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.pair_problem import PairProblem, by_station
from algorithms.arrays import Array, IndexPairs, Matrix
from algorithms.geometry.lines import Lines


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Covariances of what several lines have in common (MATH 3.3); None: the lines of that side are independent."""

    target_planes: Float64[Array, "target_planes 3 3"] | None = None
    """Of the planes that the target's `Lines.parents` count, (a1, a2, b) of `Planes.covariances`."""
    source_planes: Float64[Array, "source_planes 3 3"] | None = None
    """The same for the source."""
    target_photos: Float64[Array, "target_photos 6 6"] | None = None
    """Of the mounts of the photos that the target's `Lines.photos` count (rotation vector, translation)."""
    source_photos: Float64[Array, "source_photos 6 6"] | None = None
    """The same for the source."""


NOTHING_SHARED = SharedErrors()


def residual_covariance(
    target: Lines, source: Lines, pairs: IndexPairs, target_from_source: RigidTransform, shared: SharedErrors
) -> Matrix:
    """Give the joint covariance (4n, 4n) of the residuals of `LineLine` (MATH 3.2, 3.3).

    Parameters
    ----------
    target, source
        Lines of both scans.
    pairs
        (n, 2) numbers of target line and source line.
    target_from_source
        Pose at which the residuals are taken.
    shared
        What several lines have in common.

    Raises
    ------
    InvalidInputError
        When a covariance of what is shared is not positive definite.
    """
    problem = PairProblem(
        (LineLine(target, source, pairs),),
        by_station(shared.target_planes, shared.source_planes),
        by_station(shared.target_photos, shared.source_photos),
    )
    system = problem.at(target_from_source)
    joint = system.joint_covariance
    return np.asarray(block_diag(*system.covariances[0]) if joint is None else joint)
