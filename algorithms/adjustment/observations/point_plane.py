"""A point of one scan on a plane of the other: one distance must vanish (MATH 3.1; VGI 4/2003, plane tie points)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.between_stations import BetweenStations
from algorithms.adjustment.observations.linearised import FeatureNoise, Linearised
from algorithms.arrays import Array, IndexPairs, Points, Vector3
from algorithms.geometry.planes import Planes
from algorithms.geometry.point_sets import PointSet


@dataclass(frozen=True, eq=False)
class PointPlane(BetweenStations):
    """Points of the source that lie on planes of the target (MATH 3.1, 5.2)."""

    target: Planes
    source: PointSet
    pairs: IndexPairs
    """(n, 2) numbers of target plane and source point."""
    target_station: int = 0
    """Number of the target's pose among the unknowns."""
    source_station: int = 1
    """Number of the source's pose."""

    def __len__(self) -> int:
        return len(self.pairs)

    def selected(self, which: Array) -> "PointPlane":
        """Keep some of the correspondences, by mask or numbers."""
        return replace(self, pairs=self.pairs[which])

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "PointPlane":
        """Give the same observations relative to local origins."""
        return replace(
            self,
            target=replace(self.target, centroids=self.target.centroids - target_origin_m),
            source=replace(self.source, coordinates=self.source.coordinates - source_origin_m),
        )

    def target_points(self) -> Points:
        """Give the centroids of the target planes, (n, 3) [m]."""
        return np.asarray(self.target.centroids[self.pairs[:, 0]])

    def source_points(self) -> Points:
        """Give the source points, (n, 3) [m]."""
        return np.asarray(self.source.coordinates[self.pairs[:, 1]])

    def noises(self) -> tuple[FeatureNoise, FeatureNoise]:
        """Say how the errors of planes and points come about; points on one plane share its error."""
        numbers = self.pairs[:, 0]
        identity = np.broadcast_to(np.eye(3), (len(numbers), 3, 3))
        return (
            FeatureNoise(self.target.covariances[numbers], numbers[:, None], identity, self.target_station),
            FeatureNoise.independent(self.source.covariances[self.pairs[:, 1]]),
        )

    def linearised(self, pose: RigidTransform) -> Linearised:
        """Compute the distances r = n2.(R x1 + t - c2) and their derivatives.

        The plane's errors turn its normal by E2 a and shift it by b along the normal: dr = (E2ᵀ (x' - c2)).a - b.
        """
        i, n = self.pairs[:, 0], len(self)
        rotation = pose.rotation.as_matrix()
        normals, turned = self.target.normals[i], self.source_points() @ rotation.T
        gaps = turned + np.asarray(pose.translation) - self.target.centroids[i]
        pose_jacobians = np.zeros((n, 1, 6))
        pose_jacobians[:, 0, :3] = np.cross(turned, normals)
        pose_jacobians[:, 0, 3:] = normals
        target_jacobians = np.full((n, 1, 3), -1.0)
        target_jacobians[:, 0, :2] = np.einsum("nij,ni->nj", self.target.bases[i], gaps)
        residuals = np.einsum("ni,ni->n", normals, gaps)[:, None]
        return Linearised(residuals, pose_jacobians, target_jacobians, (normals @ rotation)[:, None, :])

    def translation_information(self, covariances: Array) -> Array:
        """Give (n, 3, 3) what each distance tells of a shift [1/m²]."""
        normals = self.target.normals[self.pairs[:, 0]]
        return np.asarray(np.einsum("ni,nj->nij", normals, normals) / covariances[:, 0, 0][:, None, None])

    def ghost_shift_information(self, covariances: Array, direction: Vector3) -> float:
        """Give the information on a shift that noise of the normals alone pretends [1/m²]."""
        i = self.pairs[:, 0]
        across = np.einsum("nji,j->ni", self.target.bases[i], direction)
        pretended = np.einsum("ni,nij,nj->n", across, self.target.covariances[i, :2, :2], across)
        return float((pretended / covariances[:, 0, 0]).sum())

    def ghost_turn_information(self, axis: Vector3) -> float:
        """Give the most information on a turn about its normal that noise of one plane can pretend [1/rad²]."""
        along = self.target.normals[self.pairs[:, 0]] @ axis
        return float((along**2).sum())
