"""A point seen in both scans: three coordinate differences must vanish (MATH 3.1; Haring 2003, tie points)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.between_stations import BetweenStations
from algorithms.adjustment.observations.linearised import FeatureNoise, Linearised
from algorithms.arrays import Array, IndexPairs, Points, Vector3
from algorithms.geometry.point_sets import PointSet
from algorithms.geometry.rotations import cross_matrices


@dataclass(frozen=True, eq=False)
class PointPoint(BetweenStations):
    """Correspondences between points of the target and points of the source (MATH 3.1, 5.2)."""

    target: PointSet
    source: PointSet
    pairs: IndexPairs
    """(n, 2) numbers of target point and source point."""
    target_station: int = 0
    """Number of the target's pose among the unknowns."""
    source_station: int = 1
    """Number of the source's pose."""

    def __len__(self) -> int:
        return len(self.pairs)

    def selected(self, which: Array) -> "PointPoint":
        """Keep some of the correspondences, by mask or numbers."""
        return replace(self, pairs=self.pairs[which])

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "PointPoint":
        """Give the same observations relative to local origins."""
        return replace(
            self,
            target=replace(self.target, coordinates=self.target.coordinates - target_origin_m),
            source=replace(self.source, coordinates=self.source.coordinates - source_origin_m),
        )

    def target_points(self) -> Points:
        """Give the target points, (n, 3) [m]."""
        return np.asarray(self.target.coordinates[self.pairs[:, 0]])

    def source_points(self) -> Points:
        """Give the source points, (n, 3) [m]."""
        return np.asarray(self.source.coordinates[self.pairs[:, 1]])

    def noises(self) -> tuple[FeatureNoise, FeatureNoise]:
        """Say how the errors of target and source points come about."""
        return (
            FeatureNoise.independent(self.target.covariances[self.pairs[:, 0]]),
            FeatureNoise.independent(self.source.covariances[self.pairs[:, 1]]),
        )

    def linearised(self, pose: RigidTransform) -> Linearised:
        """Compute residuals r = R x1 + t - x2 and their derivatives."""
        n = len(self)
        rotation = pose.rotation.as_matrix()
        turned = self.source_points() @ rotation.T
        pose_jacobians = np.zeros((n, 3, 6))
        pose_jacobians[:, :, :3] = -cross_matrices(turned)
        pose_jacobians[:, :, 3:] = np.eye(3)
        return Linearised(
            turned + np.asarray(pose.translation) - self.target_points(),
            pose_jacobians,
            np.broadcast_to(-np.eye(3), (n, 3, 3)),
            np.broadcast_to(rotation, (n, 3, 3)),
        )

    def translation_information(self, covariances: Array) -> Array:
        """Give (n, 3, 3) what each point tells of a shift [1/m²]."""
        return np.asarray(np.linalg.inv(covariances))

    def ghost_shift_information(self, covariances: Array, direction: Vector3) -> float:  # noqa: ARG002 - contract
        """Give the information on a shift that noise alone pretends: none, a point's derivative is exact."""
        return 0.0

    def ghost_turn_information(self, axis: Vector3) -> float:  # noqa: ARG002 - the same about every axis
        """Give the information on a turn that noise alone pretends [1/rad²].

        About an axis through the points their own errors are the levers: two components of half a unit each, as one
        of the two points takes part.
        """
        return float(len(self))
