"""What observation types that relate features of two stations have in common (MATH 1.4, 3.1, 5.2)."""

from abc import ABC, abstractmethod
from typing import final

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.linearised import Derivative, Equations, Linearised
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array, Points, Vector3
from algorithms.geometry.rotations import cross_matrix


class BetweenStations(ABC):
    """Observations that depend on the relative pose of two stations only (MATH 1.4, 3.1, 5.2)."""

    target_station: int
    source_station: int

    @abstractmethod
    def __len__(self) -> int:
        """Give the number of blocks."""

    @abstractmethod
    def linearised(self, pose: RigidTransform) -> Linearised:
        """Linearise at a pose, target from source."""

    @abstractmethod
    def target_points(self) -> Points:
        """Give the points (k, 3) that show where the target's geometry is [m]."""

    @abstractmethod
    def source_points(self) -> Points:
        """Give the points (k, 3) that show where the source's geometry is [m]."""

    @abstractmethod
    def translation_information(self, covariances: Array) -> Array:
        """Give (n, 3, 3) what each block tells of a shift (MATH 5.2) [1/m²].

        Parameters
        ----------
        covariances
            (n, d, d) of the residual blocks.
        """

    @abstractmethod
    def ghost_shift_information(self, covariances: Array, direction: Vector3) -> float:
        """Give the information on a shift along a direction that noise alone pretends (MATH 5.2) [1/m²]."""

    @abstractmethod
    def ghost_turn_information(self, axis: Vector3) -> float:
        """Give the information on a turn about an axis that noise alone pretends (MATH 5.2) [1/rad²]."""

    @final
    def extent_m(self) -> float:
        """Give the largest coordinate that takes part [m]: rounding errors are relative to it."""
        return float(max(np.abs(self.target_points()).max(initial=0.0), np.abs(self.source_points()).max(initial=0.0)))

    @final
    def equations(self, unknowns: Unknowns) -> Equations:
        """Carry derivatives by the relative pose over to the poses of the two stations.

        With T = T_t⁻¹ T_s, R_t of the target: w = R_tᵀ (w_s - w_t) and dt = R_tᵀ (dt_s - dt_t + S(t_s - t_t) w_t),
        from R <- Exp(w) R, t <- t + dt on each pose (MATH 1.4).
        """
        i, j = self.target_station, self.source_station
        pose = unknowns.relative(i, j)
        relative = self.linearised(pose)
        back = unknowns.rotations[i].T
        lever = cross_matrix(back.T @ np.asarray(pose.translation))
        by_source, by_target = np.zeros((6, 6)), np.zeros((6, 6))
        by_source[:3, :3] = by_source[3:, 3:] = back
        by_target[:3, :3] = by_target[3:, 3:] = -back
        by_target[3:, :3] = back @ lever
        numbers = np.broadcast_to(np.array([[i], [j]], dtype=np.int64), (2, len(self)))
        return Equations(
            relative.residuals,
            (
                Derivative(UnknownKind.POSE, numbers[0], relative.pose_jacobians @ by_target),
                Derivative(UnknownKind.POSE, numbers[1], relative.pose_jacobians @ by_source),
            ),
            (relative.target_jacobians, relative.source_jacobians),
        )
