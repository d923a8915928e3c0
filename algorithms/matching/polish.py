"""Improve a pose by laying surface on surface (point to plane), so that correspondences can be found near it."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Scalars
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex


def polished(
    target_from_source: RigidTransform,
    target: SurfaceIndex,
    source: SurfaceIndex,
    *,
    distances_m: tuple[float, ...],
    points: int,
    rounds: int = 4,
) -> RigidTransform:
    """Move the source so that its surface and the target's lie in each other.

    Parameters
    ----------
    target_from_source
        Start, good to about the first of `distances_m`.
    target, source
        The two scans.
    distances_m
        Largest distances of corresponding surface, one stage each, falling [m].
    points
        How many surface points of each scan to use.
    rounds
        Most steps of each stage.

    Returns
    -------
    The improved pose; the start where too little fits.
    """
    pose = target_from_source
    for distance in distances_m:
        limits = EvidenceLimits(distance, np.radians(25.0), 2.5 * max(target.spacing_m, source.spacing_m))
        for _ in range(rounds):
            step = _step(pose, target, source, limits, points)
            if step is None:
                break
            pose = step * pose
            if np.linalg.norm(step.rotation.as_rotvec()) < 1e-5 and np.linalg.norm(step.translation) < 1e-4:
                break
    return pose


def _step(
    pose: RigidTransform, target: SurfaceIndex, source: SurfaceIndex, limits: EvidenceLimits, points: int
) -> RigidTransform | None:
    """Solve one weighted point-to-plane step in the target frame with both scans' planes; None if too little fits."""
    inverse = pose.inv()
    match, here = corresponding(pose, source, target, limits, points)
    back, there = corresponding(inverse, target, source, limits, points)
    moved = pose.apply(source.points[match])
    other = pose.apply(source.points[there])
    positions = np.vstack([moved, target.points[back]])
    normals = np.vstack([target.normals[here], pose.rotation.apply(source.normals[there])])
    gaps = np.concatenate(
        [
            np.einsum("ij,ij->i", target.normals[here], target.points[here] - moved),
            np.einsum("ij,ij->i", normals[len(here) :], other - target.points[back]) * -1.0,
        ]
    )
    if len(gaps) < 30:
        return None
    weights = np.concatenate([source.weights[match], target.weights[back]])
    weights = weights / (1.0 + (gaps / (0.3 * limits.max_distance_m)) ** 2)
    centre = np.average(positions, axis=0, weights=weights)
    size = max(float(np.sqrt(np.average(np.sum((positions - centre) ** 2, axis=1), weights=weights))), 1e-3)
    design = np.hstack([np.cross(positions - centre, normals) / size, normals])
    solution = _solve(design, gaps, weights)
    rotation = Rotation.from_rotvec(solution[:3] / size)
    return RigidTransform.from_components(solution[3:] + centre - rotation.apply(centre), rotation)


def _solve(design: Array, right_side: Scalars, weights: Scalars) -> Array:
    """Solve the normal equations; freedoms that the surfaces do not fix stay where they are."""
    matrix = (design * weights[:, None]).T @ design
    values, vectors = np.linalg.eigh(matrix)
    usable = values > 1e-3 * values[-1]
    projected = vectors.T @ ((design * weights[:, None]).T @ right_side)
    return np.asarray(vectors[:, usable] @ (projected[usable] / values[usable]))


def corresponding(
    fixed_from_moved: RigidTransform, moved: SurfaceIndex, fixed: SurfaceIndex, limits: EvidenceLimits, points: int
) -> tuple[Array, Array]:
    """Find which of the first `points` surface points of one scan lie on which of the other: two index arrays."""
    from algorithms.scans import surface_index_kernels as kernels

    m = min(points, len(moved.points))
    match = np.empty(m, dtype=np.int64)
    kernels.matched_surface(
        np.ascontiguousarray(fixed_from_moved.rotation.as_matrix()),
        np.ascontiguousarray(fixed_from_moved.translation, dtype=np.float64),
        moved.points[:m], moved.normals[:m], fixed.points, fixed.normals, fixed.owner, fixed.low_m, fixed.cell_m,
        limits.as_array(), match,
    )  # fmt: skip
    found = np.flatnonzero(match >= 0)
    return found, match[found]
