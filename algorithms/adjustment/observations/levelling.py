"""The direction of the vertical, seen by the inclinometers of both stations: two tilts must vanish (MATH 6.3)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.between_stations import BetweenStations
from algorithms.adjustment.observations.linearised import FeatureNoise, Linearised
from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.geometry.lines import bases_of
from algorithms.geometry.rotations import cross_matrices

SMALLEST_COSINE = 0.05
"""Cosine between the two verticals below which the tilt is no longer scaled up; such a pair is wrong anyway."""


@dataclass(frozen=True, eq=False)
class Levelling(BetweenStations):
    """Verticals in the frames of two stations (MATH 5.2, 6.3); one that is level by definition has std 0."""

    target: Points
    """(n, 3) unit vectors upwards in the target frame; (0, 0, 1) of a levelled instrument."""
    source: Points
    """(n, 3) the same in the source frame."""
    target_std_rad: Scalars
    """(n,) standard deviation of each of the two tilts."""
    source_std_rad: Scalars
    target_station: int = 0
    """Number of the target's pose among the unknowns."""
    source_station: int = 1
    """Number of the source's pose."""

    @staticmethod
    def of_levelled(target_std_rad: float, source_std_rad: float) -> "Levelling":
        """Give the observation of two instruments whose z axes are vertical up to their inclinometers' errors."""
        up = np.array([[0.0, 0.0, 1.0]])
        return Levelling(up, up, np.array([target_std_rad]), np.array([source_std_rad]))

    def __len__(self) -> int:
        return len(self.target)

    def selected(self, which: Array) -> "Levelling":
        """Keep some of the observations, by mask or numbers."""
        return replace(
            self,
            target=self.target[which],
            source=self.source[which],
            target_std_rad=self.target_std_rad[which],
            source_std_rad=self.source_std_rad[which],
        )

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "Levelling":  # noqa: ARG002 - contract
        """Give the same observations: directions do not depend on the origin."""
        return self

    def target_points(self) -> Points:
        """Give no points: the vertical is nowhere."""
        return np.empty((0, 3))

    def source_points(self) -> Points:
        """Give no points."""
        return np.empty((0, 3))

    def noises(self) -> tuple[FeatureNoise, FeatureNoise]:
        """Say how the errors of both inclinometers come about."""
        tilts = [np.square(std)[:, None, None] * np.eye(2) for std in (self.target_std_rad, self.source_std_rad)]
        return FeatureNoise.independent(tilts[0]), FeatureNoise.independent(tilts[1])

    def linearised(self, pose: RigidTransform) -> Linearised:
        """Compute residuals [tilt, tilt] = E2ᵀ u'/q, u' = R u1, q = u'.u2, and their derivatives."""
        rotation = pose.rotation.as_matrix()
        moved = self.source @ rotation.T
        projection = np.swapaxes(bases_of(self.target), 1, 2)
        q = np.maximum(np.einsum("ni,ni->n", moved, self.target), SMALLEST_COSINE)
        tilts = np.einsum("nij,nj->ni", projection, moved)
        along = tilts[:, :, None] * self.target[:, None, :] / q[:, None, None]
        by_direction = (projection - along) / q[:, None, None]
        pose_jacobians = np.zeros((len(self), 2, 6))
        pose_jacobians[:, :, :3] = -by_direction @ cross_matrices(moved)
        return Linearised(
            tilts / q[:, None],
            pose_jacobians,
            np.broadcast_to(-np.eye(2), (len(self), 2, 2)),
            by_direction @ (rotation @ bases_of(self.source)),
        )

    def translation_information(self, covariances: Array) -> Array:
        """Give (n, 3, 3) zeros: a vertical tells nothing of a shift."""
        return np.zeros((len(covariances), 3, 3))

    def ghost_shift_information(self, covariances: Array, direction: Vector3) -> float:  # noqa: ARG002 - contract
        """Give 0: a vertical does not even pretend to know a shift."""
        return 0.0

    def ghost_turn_information(self, axis: Vector3) -> float:
        """Give the information on a turn about the vertical that noise alone pretends [1/rad²]."""
        return float(((self.target @ axis) ** 2).sum())
