"""A plane, line or point that many stations see: it is the same for all of them (MATH 3.1, 6.4).

The feature itself would be an unknown with one observation from each station. It is eliminated in advance: of k
stations the first one's observation stands for it, which leaves k - 1 differences that have the error of the first one
in common. With the covariance of all of them together this gives the same poses, covariances and tests as the unknown
would, while blocks of different features stay independent of each other.

What lines seen in one photo share, the error of its mount (MATH 2.5), is an unknown with an observation of its own: a
pose near the identity among the poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.linearised import Derivative, Equations, FeatureNoise
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.observations.point_point import PointPoint
from algorithms.adjustment.observations.relative_motion import RelativeMotions
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array
from algorithms.geometry.point_sets import PointSet
from algorithms.geometry.rotations import cross_matrices

Differences: TypeAlias = LineLine | PlanePlane | PointPoint
"""What compares two members of a track."""


@dataclass(frozen=True, eq=False)
class MountShare:
    """How the error of a photo's mount moves one member of each of n tracks (MATH 2.5)."""

    member: int
    """Place of the member."""
    mounts: Int64[Array, "n"]
    """(n,) number of the mount among the poses; that of a fixed pose where the member depends on no photo."""
    jacobians: Float64[Array, "n size 6"]
    """(n, 4, 6) the line's error parameters by the mount's (rotation vector, translation); zero where there is none."""

    def selected(self, which: Array) -> "MountShare":
        """Keep some of the tracks, by mask (MATH 2.5)."""
        return MountShare(self.member, self.mounts[which], self.jacobians[which])


@dataclass(frozen=True, eq=False)
class FeatureTracks:
    """n planes, lines or points seen from k stations (MATH 3.1, 6.4); a block has k - 1 differences of 3 or 4 rows."""

    stations: Int64[Array, "n k"]
    """(n, k) whose feature each member is; no station occurs twice in a track."""
    differences: Differences
    """n (k - 1) pairs, track by track: the first member (target) and each of the others (source) in their stations'
    frames. Pair k has number k on both sides."""
    covariances: tuple[Array, ...]
    """For each of the k members (n, s, s): covariance of its error parameters, without the mounts' part."""
    mounts: Sequence[MountShare] = ()
    """What members share with other lines of their photos."""

    def __len__(self) -> int:
        return len(self.stations)

    def selected(self, which: Array) -> "FeatureTracks":
        """Keep some of the tracks, by mask."""
        others = self.stations.shape[1] - 1
        return replace(
            self,
            stations=self.stations[which],
            differences=_renumbered(self.differences, np.repeat(which, others)),
            covariances=tuple(blocks[which] for blocks in self.covariances),
            mounts=tuple(share.selected(which) for share in self.mounts),
        )

    def noises(self) -> tuple[FeatureNoise, ...]:
        """Say how the errors come about: each member by itself, mounts being unknowns."""
        return tuple(FeatureNoise.independent(blocks) for blocks in self.covariances)

    def extent_m(self) -> float:
        """Give the largest coordinate that takes part [m]."""
        return self.differences.extent_m()

    def equations(self, unknowns: Unknowns) -> Equations:
        """Stack the differences of each track: those of its type of observation between its first member and others.

        Sources are moved into the target's frame beforehand, so that one call serves all pairs of stations: with the
        identity turned by w and shifted by d instead of R, t there is dt = d + S(w) t. The first member's error is in
        all differences, every other member's in its own only.
        """
        n, k = self.stations.shape
        motions = RelativeMotions.between(unknowns, np.repeat(self.stations[:, 0], k - 1), self.stations[:, 1:].ravel())
        relative = _moved(self.differences, motions).linearised(RigidTransform.identity())
        by_shift = relative.pose_jacobians[:, :, 3:]
        by_turn = relative.pose_jacobians[:, :, :3] + by_shift @ cross_matrices(motions.translations)
        by_first, by_other = motions.derivatives(by_turn, by_shift)
        size = relative.residuals.shape[1]
        rows = (k - 1) * size
        by_pose = [by_first.reshape(n, rows, 6), *_in_own_rows(by_other.reshape(n, k - 1, size, 6))]
        by_source = relative.source_jacobians
        if isinstance(self.differences, PointPoint):
            # errors of planes and lines refer to bases, which are turned along; those of points to the station's axes
            by_source = by_source @ motions.rotations
        by_error = [
            np.ascontiguousarray(relative.target_jacobians).reshape(n, rows, size),
            *_in_own_rows(by_source.reshape(n, k - 1, size, size)),
        ]
        residuals = relative.residuals.reshape(n, rows)
        by_mounts = []
        for share in self.mounts:
            errors = _small_motions(unknowns, share.mounts)
            by_mount = by_error[share.member] @ share.jacobians
            residuals = residuals + np.einsum("nij,nj->ni", by_mount, errors)
            by_mounts.append(Derivative(UnknownKind.POSE, share.mounts, by_mount))
        return Equations(
            residuals,
            (
                *(Derivative(UnknownKind.POSE, self.stations[:, j], by_pose[j]) for j in range(k)),
                *by_mounts,
            ),
            tuple(by_error),
        )


def _in_own_rows(blocks: Array) -> list[Array]:
    """Give for each other member (n, (k - 1) s, ...) derivatives: its (n, s, ...) in its own rows, zero elsewhere."""
    n, others, size, width = blocks.shape
    spread = np.zeros((others, n, others, size, width))
    own = np.arange(others)
    spread[own, :, own] = np.swapaxes(blocks, 0, 1)
    return list(spread.reshape(others, n, others * size, width))


def _moved(differences: Differences, motions: RelativeMotions) -> Differences:
    """Move every source feature into its target's frame."""
    rotations, translations = motions.rotations, motions.translations

    def turned(vectors: Array) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", rotations, vectors))

    if isinstance(differences, PointPoint):
        points = differences.source
        moved = PointSet(turned(points.coordinates) + translations, points.covariances)
        return replace(differences, source=moved)
    if isinstance(differences, PlanePlane):
        planes = differences.source
        return replace(
            differences,
            source=replace(
                planes,
                normals=turned(planes.normals),
                centroids=turned(planes.centroids) + translations,
                bases=rotations @ planes.bases,
            ),
        )
    lines = differences.source
    return replace(
        differences,
        source=replace(
            lines,
            directions=turned(lines.directions),
            anchors=turned(lines.anchors) + translations,
            bases=rotations @ lines.bases,
        ),
    )


def _renumbered(differences: Differences, rows: Array) -> Differences:
    """Keep some pairs together with their features."""
    kept = np.flatnonzero(rows)
    pairs = np.repeat(np.arange(len(kept), dtype=np.int64)[:, None], 2, axis=1)
    if isinstance(differences, PlanePlane):
        target, source = (side.without_boundaries(kept) for side in (differences.target, differences.source))
        return replace(differences, target=target, source=source, pairs=pairs)
    if isinstance(differences, PointPoint):
        return PointPoint(differences.target[kept], differences.source[kept], pairs)
    return replace(differences, target=differences.target[kept], source=differences.source[kept], pairs=pairs)


def _small_motions(unknowns: Unknowns, numbers: Array) -> Array:
    """Give (n, 6) rotation vectors and translations of poses near the identity; zero of fixed ones."""
    chosen = unknowns.poses[numbers]
    motions = np.hstack([chosen.rotation.as_rotvec(), np.asarray(chosen.translation)])
    return np.where(unknowns.pose_is_fixed[numbers][:, None], 0.0, motions)
