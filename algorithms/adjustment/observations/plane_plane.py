"""A plane seen in both scans: two tilts and one offset must vanish (MATH 3.1)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.between_stations import BetweenStations
from algorithms.adjustment.observations.linearised import FeatureNoise, Linearised
from algorithms.arrays import Array, IndexPairs, Points, Vector3
from algorithms.geometry.planes import Planes
from algorithms.geometry.rotations import cross_matrices

SMALLEST_COSINE = 0.05
"""Cosine between matched normals below which the tilt is no longer scaled up; such a pair is wrong anyway."""


@dataclass(frozen=True, eq=False)
class PlanePlane(BetweenStations):
    """Correspondences between planes of both scans, seen from the same side (MATH 3.1, 5.2)."""

    target: Planes
    source: Planes
    pairs: IndexPairs
    """(n, 2) numbers of target plane and source plane."""

    target_station: int = 0
    """Number of the target's pose among the unknowns."""
    source_station: int = 1
    """Number of the source's pose."""

    def __len__(self) -> int:
        return len(self.pairs)

    def selected(self, which: Array) -> "PlanePlane":
        """Keep some of the correspondences, by mask or numbers."""
        return replace(self, pairs=self.pairs[which])

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "PlanePlane":
        """Give the same observations relative to local origins."""
        return replace(
            self,
            target=replace(self.target, centroids=self.target.centroids - target_origin_m),
            source=replace(self.source, centroids=self.source.centroids - source_origin_m),
        )

    def target_points(self) -> Points:
        """Give the centroids of the target planes, (n, 3) [m]: where the geometry is."""
        return np.asarray(self.target.centroids[self.pairs[:, 0]])

    def source_points(self) -> Points:
        """Give the centroids of the source planes, (n, 3) [m]."""
        return np.asarray(self.source.centroids[self.pairs[:, 1]])

    def noises(self) -> tuple[FeatureNoise, FeatureNoise]:
        """Say how the errors of target and source features come about."""
        return (
            _noise(self.target, self.pairs[:, 0], self.target_station),
            _noise(self.source, self.pairs[:, 1], self.source_station),
        )

    def linearised(self, pose: RigidTransform) -> Linearised:
        """Compute residuals [tilt, tilt, offset] in the target plane's basis and their derivatives.

        n' = R n1, c' = R c1 + t, q = n'.n2; r = [E2ᵀ n'/q; h] with h the distance from c2 along n2 to the moved plane,
        h = n'.(c' - c2)/q.
        """
        i, j = self.pairs[:, 0], self.pairs[:, 1]
        rotation, translation = pose.as_matrix()[:3, :3], np.asarray(pose.translation)
        normals = self.source.normals[j] @ rotation.T
        centroids = self.source.centroids[j] @ rotation.T + translation
        target_normals = self.target.normals[i]
        projection = np.swapaxes(self.target.bases[i], 1, 2)
        q = np.maximum(_dots(normals, target_normals), SMALLEST_COSINE)
        gaps = centroids - self.target.centroids[i]
        tilts = np.einsum("nij,nj->ni", projection, normals)
        heights = _dots(normals, gaps) / q
        along = tilts[:, :, None] * target_normals[:, None, :] / q[:, None, None]
        by_normal = (projection - along) / q[:, None, None]
        lever = (gaps - heights[:, None] * target_normals) / q[:, None]
        by_centroid = normals / q[:, None]
        pose_jacobians = np.zeros((len(i), 3, 6))
        pose_jacobians[:, :2, :3] = -by_normal @ cross_matrices(normals)
        pose_jacobians[:, 2, :3] = np.cross(normals, lever) + np.cross(centroids - translation, by_centroid)
        pose_jacobians[:, 2, 3:] = by_centroid
        bases = rotation @ self.source.bases[j]
        source_jacobians = np.zeros((len(i), 3, 3))
        source_jacobians[:, :2, :2] = by_normal @ bases
        source_jacobians[:, 2, :2] = np.einsum("nj,njk->nk", lever, bases)
        source_jacobians[:, 2, 2] = 1.0 / q
        target_jacobians = np.broadcast_to(-np.eye(3), (len(i), 3, 3))
        residuals = np.hstack([tilts / q[:, None], heights[:, None]])
        return Linearised(residuals, pose_jacobians, target_jacobians, source_jacobians)

    def translation_information(self, covariances: Array) -> Array:
        """Give (n, 3, 3) what each plane's offset tells of a shift [1/m²]."""
        normals = self.target.normals[self.pairs[:, 0]]
        return np.asarray(np.einsum("ni,nj->nij", normals, normals) / covariances[:, 2, 2][:, None, None])

    def ghost_shift_information(self, covariances: Array, direction: Vector3) -> float:
        """Give the information on a shift that noise of the normals alone pretends [1/m²]."""
        across = np.einsum("nji,j->ni", self.target.bases[self.pairs[:, 0]], direction)
        pretended = np.einsum("ni,nij,nj->n", across, covariances[:, :2, :2], across)
        return float(0.5 * (pretended / covariances[:, 2, 2]).sum())

    def ghost_turn_information(self, axis: Vector3) -> float:
        """Give the information on a turn that noise alone pretends [1/rad²]: half a unit for each tilt."""
        along = self.target.normals[self.pairs[:, 0]] @ axis
        return float((along**2).sum())


def _noise(planes: Planes, numbers: Array, station: int) -> FeatureNoise:
    jacobians = np.broadcast_to(np.eye(3), (len(numbers), 3, 3))
    return FeatureNoise(planes.covariances[numbers], numbers[:, None], jacobians, station)


def _dots(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", first, second))
