"""A pose from pairs of planes: quaternion of the normals, least squares of the offsets."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, OtherIndexPairs, Scalars, Vector3
from algorithms.closest_points.motions import best_rotation
from algorithms.geometry.planes import Planes
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import velocity_design

LEAST_SINE = 0.1
"""Normals that together reach less than this out of one plane fix no translation."""
UNEVEN_RAD, UNEVEN_M = 5e-4, 0.003
"""Standard deviations of a plane's normal and offset by the unevenness of walls, of which two scans see two pieces."""
STEPS = 4
"""Of the least squares: the start is within a degree."""


@dataclass(frozen=True, eq=False)
class PlanePairsPose:
    """A pose from pairs of planes and what its own least squares says of it."""

    pose: PoseEstimate
    """Between the frames of the planes, with the covariance that the residuals tell."""
    pairs: OtherIndexPairs
    """(n, 2) planes of target and source."""
    angle_rms_rad: float
    """Rms angle between the normals [rad]."""
    offset_rms_m: float
    """Rms distance between the planes [m]."""
    sigma0: float
    """Standard deviation of unit weight, at least 1."""


def pose_of_plane_pairs(target: Planes, source: Planes, pairs: OtherIndexPairs) -> PlanePairsPose | None:
    """Estimate the pose in which pairs of planes coincide; None where their normals leave a shift open.

    The rotation starts with that of the normals (quaternion), the translation with n·t = h_target - h_source; then
    least squares of both together, turns of the normals and offsets at the source's centroids, weighed by what the
    planes' covariances and uneven walls explain. The covariance is enlarged where the residuals are larger than that.

    Parameters
    ----------
    target, source
        Planes of both scans.
    pairs
        (n, 2) numbers of corresponding ones, n > 3.
    """
    ours, theirs = target.without_boundaries(pairs[:, 0]), source.without_boundaries(pairs[:, 1])
    if np.linalg.svd(ours.normals, compute_uv=False)[-1] < LEAST_SINE:
        return None
    areas = np.sqrt(np.minimum(ours.areas_m2, theirs.areas_m2))
    rotation = best_rotation(ours.normals, theirs.normals, areas)
    right = np.einsum("ij,ij->i", ours.normals, ours.centroids - rotation.apply(theirs.centroids))
    weighted = ours.normals * areas[:, None]
    shift = np.linalg.solve(weighted.T @ ours.normals, weighted.T @ right)
    for _ in range(STEPS):
        design, residuals, weights = _linearised(ours, theirs, rotation, shift)
        normal_matrix = (design * weights[:, None]).T @ design
        step = np.linalg.solve(normal_matrix, design.T @ (weights * residuals))
        rotation, shift = Rotation.from_rotvec(step[:3]) * rotation, shift + step[3:]
    design, residuals, weights = _linearised(ours, theirs, rotation, shift)
    factor = max(float(weights @ residuals**2) / max(len(residuals) - 6, 1), 1.0)
    covariance = factor * np.linalg.inv((design * weights[:, None]).T @ design)
    turns, offsets = residuals[: 2 * len(pairs)], residuals[2 * len(pairs) :]
    return PlanePairsPose(
        PoseEstimate(RigidTransform.from_components(shift, rotation), covariance),
        pairs,
        float(np.sqrt(2.0 * np.mean(turns**2))),
        float(np.sqrt(np.mean(offsets**2))),
        factor**0.5,
    )


def _linearised(ours: Planes, theirs: Planes, rotation: Rotation, shift: Vector3) -> tuple[Array, Scalars, Scalars]:
    """Give design (3n, 6), misclosures (3n,) and weights (3n,) of two turns and an offset of each pair."""
    normals, points = rotation.apply(theirs.normals), rotation.apply(theirs.centroids)
    arms = np.einsum("nij,ni->nj", ours.bases, points + shift - ours.centroids)
    turns = -np.einsum("nij,ni->nj", ours.bases, normals)
    offsets = -np.einsum("ij,ij->i", ours.normals, points + shift - ours.centroids)
    by_turn = np.stack([np.cross(normals, ours.bases[:, :, k]) for k in range(2)], axis=1)
    by_offset = velocity_design(points, ours.normals)
    design = np.vstack([np.pad(by_turn.reshape(-1, 3), ((0, 0), (0, 3))), by_offset])
    angular = ours.covariances[:, :2, :2]
    of_turns = np.einsum("nkk->nk", angular) + np.einsum("nkk->nk", theirs.covariances[:, :2, :2]) + UNEVEN_RAD**2
    of_offsets = ours.covariances[:, 2, 2] + theirs.covariances[:, 2, 2] + UNEVEN_M**2
    of_offsets += np.einsum("ni,nij,nj->n", arms, angular, arms) + UNEVEN_RAD**2 * np.einsum("ni,ni->n", arms, arms)
    return design, np.concatenate([turns.ravel(), offsets]), 1.0 / np.concatenate([of_turns.ravel(), of_offsets])
