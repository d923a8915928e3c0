"""What the errors of two registered stations' poses, known together, make of a distance between their surfaces."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Labels, Matrix6, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import velocity_design

Matrix12 = Float64[Array, "12 12"]

ROUNDING = 1e-9
"""A covariance whose smallest eigenvalue is below minus this share of its largest is none."""


@dataclass(frozen=True, eq=False)
class JointPoses:
    """The poses of two stations in one frame, with their joint covariance (MATH 1.4, 11.2)."""

    positions_m: Float64[Array, "2 3"]
    """(2, 3) translations of the two poses: where each station's own origin lies [m]."""
    covariance: Matrix12
    """(12, 12) of (rotation vector, translation) of the first, then of the second station; rotation vectors perturb on
    the left, in the axes of the common frame [rad, m]. The off-diagonal 6x6 blocks say what the two errors share."""

    def __post_init__(self) -> None:
        """Refuse what is no covariance.

        Raises
        ------
        InvalidInputError
            If the matrix is not symmetric, not finite, or has a negative eigenvalue.
        """
        scale = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        scale[scale == 0.0] = 1.0
        normed = self.covariance / np.outer(scale, scale)
        if not np.isfinite(self.covariance).all() or not np.allclose(normed, normed.T, rtol=0.0, atol=1e-6):
            raise InvalidInputError("joint covariance", "it is not a symmetric matrix of finite numbers")
        values = np.linalg.eigvalsh(0.5 * (normed + normed.T))
        if values[0] < -max(ROUNDING * values[-1], 1e-6):
            raise InvalidInputError("joint covariance", "it has a negative eigenvalue, so it is no covariance")

    def variances_along(self, points: Points, normals: Points) -> Scalars:
        """Give the variance (n,) of n · (x₂ − x₁) at places p that both stations see, from the poses alone [m²].

        With the error δx = δθ × (p − t) + δt of each station, n · δx = aᵀ (δθ, δt), a = ((p − t) × n, n), so that
        var = a₁ᵀ S₁₁ a₁ + a₂ᵀ S₂₂ a₂ − 2 a₁ᵀ S₁₂ a₂ (MATH 11.2). O(n).

        Parameters
        ----------
        points
            (n, 3) places in the common frame [m].
        normals
            (n, 3) unit directions in which distances are measured.
        """
        first, second = (velocity_design(points - position, normals) for position in self.positions_m)
        jacobian = np.hstack([-first, second])
        return np.asarray(np.maximum(np.einsum("ni,ni->n", jacobian @ self.covariance, jacobian), 0.0))

    def moved(self, origin_m: Vector3) -> "JointPoses":
        """Give the same in coordinates reduced by an origin [m]; the covariance does not change."""
        return JointPoses(self.positions_m - origin_m, self.covariance)


@dataclass(frozen=True, eq=False)
class StationPairs:
    """Two clouds of several stations each: which pair of them meets at each of n places, and their joint poses."""

    pairs: Mapping[tuple[int, int], JointPoses]
    """By station of the first and of the second cloud."""
    first: Labels
    """(n,) station of the first cloud at each place."""
    second: Labels
    """(n,) station of the second."""

    def variances_along(self, points: Points, normals: Points) -> Scalars:
        """Give the variance (n,) of `JointPoses.variances_along`, that of each place from its own pair of stations."""
        variances = np.zeros(len(points))
        for (one, two), poses in self.pairs.items():
            here = (self.first == one) & (self.second == two)
            if here.any():
                variances[here] = poses.variances_along(points[here], normals[here])
        return variances


def of_pair(pose: PoseEstimate) -> JointPoses:
    """Give the joint poses of a registered pair in the target's frame: the target has no error there."""
    covariance = np.zeros((12, 12))
    covariance[6:, 6:] = pose.covariance
    return JointPoses(np.stack([np.zeros(3), pose.translation_m]), covariance)


def exact_poses() -> JointPoses:
    """Give poses without error."""
    return JointPoses(np.zeros((2, 3)), np.zeros((12, 12)))


def of_stations(first: PoseEstimate, second: PoseEstimate, cross: Matrix6) -> JointPoses:
    """Give the joint poses of two stations of a network from their poses and the covariance between them.

    Parameters
    ----------
    first, second
        Poses in the common frame, each with its own covariance.
    cross
        (6, 6) covariance of the first one's parameters (rows) with the second one's (columns).
    """
    covariance = np.block([[first.covariance, cross], [cross.T, second.covariance]])
    return JointPoses(np.stack([first.translation_m, second.translation_m]), covariance)
