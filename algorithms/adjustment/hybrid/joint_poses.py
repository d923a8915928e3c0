"""Stations whose poses to each other are known together, as a registration of scans gives them (MATH 6.7)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.hybrid.observations import Block, Observations, Stacked
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.adjustment.observations.relative_poses import inverse_left_jacobians
from algorithms.arrays import Array, Indices
from algorithms.geometry.rotations import cross_matrices


@dataclass(frozen=True, eq=False)
class JointPoses(Observations):
    """One observation: the poses of k stations in the frame of another one, with their common covariance (MATH 6.7).

    Its covariance is (1, 6k, 6k), of (rotation vector on the left [rad], translation [m]) of each, in the axes of the
    base station.
    """

    base: int
    """Station whose frame it is."""
    stations: Indices
    """(k,) the others."""
    rotations: Array
    """(k, 3, 3) base from station."""
    translations: Array
    """(k, 3) [m]."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.7)."""
        numbers = (self.base, *self.stations.tolist())
        return tuple((Kind.POSE, np.array([number], dtype=np.int64)) for number in numbers)

    def stacked(self, state: State) -> Stacked:
        """Compute (Log(R Roᵀ), t - to) of R = R0ᵀ Rk, t = R0ᵀ (tk - t0), and derivatives (MATH 6.7).

        Rotations move in the stations' own axes here: R <- Exp(-w0) R Exp(wk) = Exp(R wk - w0) R, and
        t <- t + S(t) w0 + R0ᵀ (dtk - dt0).
        """
        k = len(self.stations)
        back = state.rotations[self.base].T
        rotations = back @ state.rotations[self.stations]
        translations = (state.positions[self.stations] - state.positions[self.base]) @ back.T
        turns = Rotation.from_matrix(rotations @ np.swapaxes(self.rotations, 1, 2)).as_rotvec()
        by_turn = inverse_left_jacobians(turns)
        residuals = np.hstack([turns, translations - self.translations]).reshape(1, 6 * k)
        by_base = np.zeros((k, 6, 6))
        by_base[:, :3, :3] = -by_turn
        by_base[:, 3:, :3] = cross_matrices(translations)
        by_base[:, 3:, 3:] = -back
        blocks = [Block(Kind.POSE, np.array([self.base], dtype=np.int64), by_base.reshape(1, 6 * k, 6))]
        for place, station in enumerate(self.stations.tolist()):
            own = np.zeros((1, 6 * k, 6))
            own[0, 6 * place : 6 * place + 3, :3] = by_turn[place] @ rotations[place]
            own[0, 6 * place + 3 : 6 * place + 6, 3:] = back
            blocks.append(Block(Kind.POSE, np.array([station], dtype=np.int64), own))
        return Stacked(residuals, tuple(blocks))


def joint_poses(base: int, poses: Mapping[int, RigidTransform], covariance: Array) -> JointPoses:
    """Make an observation of what scans say of some stations (MATH 6.7).

    Parameters
    ----------
    base
        The station in whose frame the poses are.
    poses
        Base from station of the others, in the order of the covariance.
    covariance
        (6 k, 6 k).
    """
    stations = np.array(list(poses), dtype=np.int64)
    return JointPoses(
        covariance[None],
        base,
        stations,
        np.array([pose.rotation.as_matrix() for pose in poses.values()]).reshape(-1, 3, 3),
        np.array([pose.translation for pose in poses.values()], dtype=np.float64).reshape(-1, 3),
    )
