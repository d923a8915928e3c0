"""How well the position of each point of a registered scan is known."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Matrix3, Matrix6, Points, Scalars, Vector3
from algorithms.geometry.poses import PoseEstimate


@dataclass(frozen=True, eq=False)
class PositionStd:
    """Standard deviation of positions, from the covariance of the scan's pose and the noise of its ranges.

    A point at d from the scan's origin, in target axes, moves by δp = δθ × d + δt, so tr C is a polynomial of second
    degree in d: with the blocks S of the pose's covariance
    tr C = dᵀ (tr(Sθθ) I − Sθθ) d + 2 wᵀ d + tr(Stt), w = E(δt × δθ) (MATH 1.4). The range adds its variance along the
    ray. The pose's error is common to all points of a scan: it does not average out over them.
    """

    pose: PoseEstimate
    """World from scan with its covariance."""
    range_std_m: float = 0.0
    """Standard deviation of single ranges [m]."""

    def at(self, points_in_scan: Points, origin_m: Vector3) -> Scalars:
        """Give √(σx² + σy² + σz²) of each point [m].

        Parameters
        ----------
        points_in_scan
            (n, 3) points of the scan frame minus `origin_m` [m].
        origin_m
            (3,) what was subtracted [m].
        """
        quadratic, linear, constant = self._polynomial()
        rotation = self.pose.rotation.as_matrix()
        # in scan axes d is the point itself: R is put into the coefficients
        quadratic, linear = rotation.T @ quadratic @ rotation, rotation.T @ linear
        # about the local origin, so that large numbers meet only once
        shifted = linear + quadratic @ origin_m
        constant += float(origin_m @ (quadratic @ origin_m + 2.0 * linear))
        x, y, z = (points_in_scan[:, axis] for axis in range(3))
        variance = (
            x * (quadratic[0, 0] * x + 2.0 * (quadratic[0, 1] * y + quadratic[0, 2] * z + shifted[0]))
            + y * (quadratic[1, 1] * y + 2.0 * (quadratic[1, 2] * z + shifted[1]))
            + z * (quadratic[2, 2] * z + 2.0 * shifted[2])
        )
        return np.asarray(np.sqrt(np.maximum(variance + (constant + self.range_std_m**2), 0.0)))

    def _polynomial(self) -> tuple[Matrix3, Vector3, float]:
        covariance: Matrix6 = self.pose.covariance
        turns, mixed, shifts = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
        quadratic = np.trace(turns) * np.eye(3) - turns
        # (δθ × d) · δt = d · (δt × δθ)
        linear = np.array([mixed[2, 1] - mixed[1, 2], mixed[0, 2] - mixed[2, 0], mixed[1, 0] - mixed[0, 1]])
        return quadratic, linear, float(np.trace(shifts))
