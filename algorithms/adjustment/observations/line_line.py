"""A line seen in both scans: two tilts and two offsets must vanish (MATH 3.1)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.between_stations import BetweenStations
from algorithms.adjustment.observations.linearised import FeatureNoise, Linearised
from algorithms.arrays import Array, IndexPairs, Points, Vector3
from algorithms.geometry.line_motion import lines_about
from algorithms.geometry.lines import Lines
from algorithms.geometry.rotations import cross_matrices

SMALLEST_COSINE = 0.05
"""Cosine between matched directions below which the tilt (a tangent) is no longer scaled up: such a pair is wrong
anyway, and must stay finite until the test removes it."""


@dataclass(frozen=True, eq=False)
class LineLine(BetweenStations):
    """Correspondences between lines of the target and lines of the source (MATH 3.1, 5.2)."""

    target: Lines
    source: Lines
    pairs: IndexPairs
    """(n, 2) numbers of target line and source line."""

    target_station: int = 0
    """Number of the target's pose among the unknowns."""
    source_station: int = 1
    """Number of the source's pose."""

    def __len__(self) -> int:
        return len(self.pairs)

    def selected(self, which: Array) -> "LineLine":
        """Keep some of the correspondences, by mask or numbers."""
        return replace(self, pairs=self.pairs[which])

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "LineLine":
        """Give the same observations relative to local origins."""
        return replace(
            self,
            target=lines_about(self.target, target_origin_m),
            source=lines_about(self.source, source_origin_m),
        )

    @cached_property
    def matched_target(self) -> Lines:
        """Target lines in the order of the correspondences."""
        return self.target[self.pairs[:, 0]]

    @cached_property
    def matched_source(self) -> Lines:
        """Source lines in the order of the correspondences."""
        return self.source[self.pairs[:, 1]]

    def target_points(self) -> Points:
        """Give the ends of the target pieces, (2n, 3) [m]: where the geometry is."""
        return np.vstack(self.matched_target.end_points)

    def source_points(self) -> Points:
        """Give the ends of the source pieces, (2n, 3) [m]."""
        return np.vstack(self.matched_source.end_points)

    def noises(self) -> tuple[FeatureNoise, FeatureNoise]:
        """Say how the errors of target and source features come about."""
        return (
            _noise(self.matched_target, self.target_station),
            _noise(self.matched_source, self.source_station),
        )

    def linearised(self, pose: RigidTransform) -> Linearised:
        """Compute residuals [tilt, tilt, offset, offset] in the target line's basis and their derivatives.

        d' = s R d1, c' = R c1 + t, q = d'.d2, lam = ((c2 - c').d2)/q, p = c' + lam d';
        r = [E2ᵀ d'/q; E2ᵀ (p - c2)]. The offsets are taken where the moved line passes the target's anchor, so the
        source tilt is extrapolated there (lam) when the scans see different pieces.
        """
        target, source = self.matched_target, self.matched_source
        n = len(target)
        rotation, translation = pose.as_matrix()[:3, :3], np.asarray(pose.translation)
        moved = source.directions @ rotation.T
        signs = np.where(_dots(moved, target.directions) < 0.0, -1.0, 1.0)
        moved = moved * signs[:, None]
        anchors = source.anchors @ rotation.T + translation
        q = np.maximum(_dots(moved, target.directions), SMALLEST_COSINE)
        lam = _dots(target.anchors - anchors, target.directions) / q
        points = anchors + lam[:, None] * moved
        projection = np.swapaxes(target.bases, 1, 2)
        tilts = np.einsum("nij,nj->ni", projection, moved)
        offsets = np.einsum("nij,nj->ni", projection, points - target.anchors)
        along = tilts[:, :, None] * target.directions[:, None, :] / q[:, None, None]
        by_point = projection - along  # P_p
        by_direction = by_point / q[:, None, None]  # P_d
        pose_jacobians = np.zeros((n, 4, 6))
        pose_jacobians[:, :2, :3] = -by_direction @ cross_matrices(moved)
        pose_jacobians[:, 2:, :3] = -by_point @ cross_matrices(points - translation)
        pose_jacobians[:, 2:, 3:] = by_point
        bases = rotation @ source.bases
        source_jacobians = np.zeros((n, 4, 4))
        source_jacobians[:, :2, :2] = signs[:, None, None] * by_direction @ bases
        source_jacobians[:, 2:, :2] = (signs * lam)[:, None, None] * by_point @ bases
        source_jacobians[:, 2:, 2:] = by_point @ bases
        target_jacobians = np.broadcast_to(-np.eye(4), (n, 4, 4))
        return Linearised(np.hstack([tilts / q[:, None], offsets]), pose_jacobians, target_jacobians, source_jacobians)

    def translation_information(self, covariances: Array) -> Array:
        """Give (n, 3, 3) what each line's offsets tell of a shift, E2 Sb⁻¹ E2ᵀ (MATH 5.2) [1/m²].

        Parameters
        ----------
        covariances
            (n, 4, 4) of the residual blocks.
        """
        bases = self.target.bases[self.pairs[:, 0]]
        return np.asarray(bases @ np.linalg.inv(covariances[:, 2:, 2:]) @ np.swapaxes(bases, 1, 2))

    def ghost_shift_information(self, covariances: Array, direction: Vector3) -> float:
        """Give the information on a shift that noise of the directions alone pretends, MATH 5.2 [1/m²].

        The derivative by a shift along the line vanishes up to the tilt of one of the two lines; the covariances hold
        the tilts of both, hence the half.
        """
        ratio = np.linalg.inv(covariances[:, 2:, 2:]) @ covariances[:, :2, :2]
        along = self.target.directions[self.pairs[:, 0]] @ direction
        return float(0.5 * (along**2 * np.trace(ratio, axis1=1, axis2=2)).sum())

    def ghost_turn_information(self, axis: Vector3) -> float:
        """Give the information on a turn that noise alone pretends [1/rad²].

        A turn about the line itself moves nothing, yet the tilt and offset errors of one of the two lines take part in
        it: each of the four components pretends half a unit.
        """
        along = self.target.directions[self.pairs[:, 0]] @ axis
        return float(2.0 * (along**2).sum())


def _noise(lines: Lines, station: int) -> FeatureNoise:
    has_planes = (lines.parents >= 0).all(axis=1) & (lines.parent_jacobians != 0.0).any(axis=(1, 2))
    numbers = np.where(has_planes[:, None], lines.parents, -1)
    photos, by_mounts = None, None
    if lines.photos is not None and lines.photo_jacobians is not None:
        photos, by_mounts = lines.photos[:, None], lines.photo_jacobians
        if lines.second_photos is not None and lines.second_photo_jacobians is not None:
            photos = np.column_stack([photos, lines.second_photos])
            by_mounts = np.concatenate([by_mounts, lines.second_photo_jacobians], axis=2)
    return FeatureNoise(
        lines.covariances, numbers, lines.parent_jacobians, station, photos, by_mounts, lines.private_covariances
    )


def _dots(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", first, second))
