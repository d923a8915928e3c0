"""The adjustment problem: observations, and the covariance they have together (MATH 3.1)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64
from scipy import sparse
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations import Observation
from algorithms.adjustment.observations.linearised import FeatureNoise
from algorithms.arrays import Array, Matrices3, Points, Vector3
from algorithms.errors import InvalidInputError

TargetPlaneCovariances: TypeAlias = Float64[Array, "target_planes 3 3"]
SourcePlaneCovariances: TypeAlias = Float64[Array, "source_planes 3 3"]


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """All residuals of a problem at one pose, stacked; m in number."""

    residuals: Array
    """(m,) contradictions [rad, m]."""
    jacobian: Array
    """(m, 6) derivatives by (rotation vector on the left, translation)."""
    covariances: tuple[Array, ...]
    """For each observation type (n, d, d): the covariance of each block by itself."""
    joint_covariance: Array | None
    """(m, m) covariance of everything together, possibly singular; None where blocks are independent."""

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """Number n and size d of the blocks of each type, in stacking order."""
        return [(blocks.shape[0], blocks.shape[1]) for blocks in self.covariances]

    @property
    def block_of_row(self) -> Array:
        """(m,) number of the block each residual belongs to."""
        numbers, first = [], 0
        for n, d in self.shapes:
            numbers.append(np.repeat(np.arange(first, first + n), d))
            first += n
        return np.concatenate(numbers)

    def split(self, stacked: Array) -> list[Array]:
        """Cut something stacked like the residuals, (m, ...), into one (n, d, ...) array for each type."""
        pieces, first = [], 0
        for n, d in self.shapes:
            pieces.append(stacked[first : first + n * d].reshape(n, d, *stacked.shape[1:]))
            first += n * d
        return pieces


@dataclass(frozen=True, eq=False)
class Problem:
    """Correspondences that together determine one pose, target from source."""

    observations: Sequence[Observation]
    """One entry for each type; blocks are numbered through in this order."""
    target_plane_covariances: TargetPlaneCovariances | None = None
    """(p, 3, 3) of all target planes that lines depend on; None treats lines of this side as independent."""
    source_plane_covariances: SourcePlaneCovariances | None = None
    """The same for the source."""

    def __len__(self) -> int:
        return sum(len(observation) for observation in self.observations)

    def selected(self, keep: Array) -> "Problem":
        """Keep the blocks for which the mask (number of blocks,) is True."""
        splits = np.cumsum([len(observation) for observation in self.observations])[:-1]
        parts = np.split(keep, splits)
        kept = tuple(part.selected(mask) for part, mask in zip(self.observations, parts, strict=True))
        return replace(self, observations=kept)

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "Problem":
        """Give the same problem between frames whose origins lie at the given points."""
        return replace(
            self, observations=tuple(part.about(target_origin_m, source_origin_m) for part in self.observations)
        )

    def target_points(self) -> Points:
        """Give the points (k, 3) that show where the target geometry is [m]."""
        return np.vstack([part.target_points() for part in self.observations])

    def source_points(self) -> Points:
        """Give the points (k, 3) that show where the source geometry is [m]."""
        return np.vstack([part.source_points() for part in self.observations])

    def linearised(self, pose: RigidTransform) -> LinearSystem:
        """Stack residuals, derivatives and covariances at a pose.

        Blocks that depend on the same plane share its error: C = B Σ Bᵀ, B through the planes' parameters.
        """
        parts = [part.linearised(pose) for part in self.observations]
        residuals = np.concatenate([part.residuals.ravel() for part in parts])
        jacobian = np.vstack([part.pose_jacobians.reshape(-1, 6) for part in parts])
        sides = [
            (self.target_plane_covariances, [part.target_noise() for part in self.observations]),
            (self.source_plane_covariances, [part.source_noise() for part in self.observations]),
        ]
        derivatives = [[part.target_jacobians for part in parts], [part.source_jacobians for part in parts]]
        alone = [np.zeros((*part.residuals.shape, part.residuals.shape[1])) for part in parts]
        through_planes = []
        for (plane_covariances, noises), jacobians in zip(sides, derivatives, strict=True):
            for k, (noise, factor) in enumerate(zip(noises, jacobians, strict=True)):
                own = _private_part(noise, plane_covariances)
                alone[k] = alone[k] + factor @ own @ np.swapaxes(factor, 1, 2)
            if plane_covariances is not None:
                through_planes.append(_through_planes(noises, jacobians, plane_covariances))
        if not through_planes:
            return LinearSystem(residuals, jacobian, tuple(alone), None)
        joint = np.zeros((len(residuals), len(residuals)))
        rows = _rows_of_blocks(alone)
        for places, blocks in zip(rows, alone, strict=True):
            joint[places[:, :, None], places[:, None, :]] = blocks
        for root in through_planes:
            joint = joint + (root @ root.T).toarray()
        diagonal = tuple(joint[places[:, :, None], places[:, None, :]] for places in rows)
        return LinearSystem(residuals, jacobian, diagonal, joint)


def _private_part(noise: FeatureNoise, plane_covariances: Matrices3 | None) -> Array:
    """Give the covariances of what is not explained by planes."""
    if plane_covariances is None:
        return noise.private
    explained = _depends_on_planes(noise)
    return np.where(explained[:, None, None], 0.0, noise.private)


def _depends_on_planes(noise: FeatureNoise) -> Array:
    return np.asarray((noise.plane_numbers >= 0).all(axis=1))


def _through_planes(
    noises: Sequence[FeatureNoise], jacobians: Sequence[Array], plane_covariances: Matrices3
) -> sparse.csr_array:
    """Give the sparse (m, 3p) factor F whose F Fᵀ is the covariance that comes through the planes."""
    try:
        roots = np.linalg.cholesky(plane_covariances)
    except np.linalg.LinAlgError as error:
        raise InvalidInputError("covariance of a plane", "it is not positive definite") from error
    parts = []
    for noise, jacobian in zip(noises, jacobians, strict=True):
        n, d = jacobian.shape[:2]
        rows, columns, values = [], [], []
        used = np.flatnonzero(_depends_on_planes(noise))
        for k in range(noise.plane_numbers.shape[1]):
            numbers = noise.plane_numbers[used, k]
            through = jacobian[used] @ noise.plane_jacobians[used][:, :, 3 * k : 3 * k + 3] @ roots[numbers]
            rows.append(np.repeat((used[:, None] * d + np.arange(d)).ravel(), 3))
            columns.append(np.repeat(numbers[:, None] * 3 + np.arange(3), d, axis=0).ravel())
            values.append(through.ravel())
        shape = (n * d, 3 * len(plane_covariances))
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        parts.append(sparse.coo_array(entries, shape=shape))
    return sparse.csr_array(sparse.vstack(parts))


def _rows_of_blocks(blocks: Sequence[Array]) -> list[Array]:
    """Give for each type (n, d) row numbers in the stack."""
    rows, first = [], 0
    for part in blocks:
        n, d = part.shape[:2]
        rows.append(first + np.arange(n * d).reshape(n, d))
        first += n * d
    return rows
