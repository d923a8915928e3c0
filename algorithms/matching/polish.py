"""Improve a pose by laying surface on surface (point to plane), so that correspondences can be found near it."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Indices, Points, Scalars, Vector3
from algorithms.geometry.rotations import rotation_matrix, velocity_design
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex
from algorithms.scans.surface_matches import corresponding

DOUBTFUL_SHARE = 0.3
"""A gap this share of the largest distance counts half."""
LEAST_GAPS = 30
SETTLED_RAD, SETTLED_M = 1e-5, 1e-4
"""A smaller step is the last."""
LEAST_INFORMATION = 1e-3
"""Freedoms on which the surfaces say less than this share of what they say on the best known one count as open."""


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
            if np.linalg.norm(step.rotation.as_rotvec()) < SETTLED_RAD and np.linalg.norm(step.translation) < SETTLED_M:
                break
    return pose


@dataclass(frozen=True, eq=False)
class SurfaceGaps:
    """n distances between corresponding surface of two scans in a pose, in the target frame."""

    positions: Points
    """(n, 3) points of the source, or where the source touches a point of the target [m]."""
    normals: Points
    """(n, 3) unit directions in which the distances are measured."""
    gaps_m: Scalars
    """(n,) how far the source should move along them [m]."""
    weights: Scalars
    """(n,) weights that give every direction of normals the same say."""
    of_target: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(n,) surface point of the target that each rests on, a number of its index."""
    of_source: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(n,) that of the source."""

    def design(self, centre_m: Vector3) -> Array:
        """Give the derivatives (n, 6) of the distances by rotation about a centre, and translation."""
        return velocity_design(self.positions - centre_m, self.normals)


def surface_gaps(
    pose: RigidTransform,
    target: SurfaceIndex,
    source: SurfaceIndex,
    limits: EvidenceLimits,
    points: int,
    *,
    left_out: tuple[Array, Array] | None = None,
) -> SurfaceGaps:
    """Measure between corresponding surface, from each scan's points to the other's planes.

    Parameters
    ----------
    pose
        Target from source.
    target, source
        The two scans.
    limits
        What corresponds.
    points
        How many surface points of each scan to use.
    left_out
        True for points of the target and of the source that take no part; None: all do.
    """
    match, here = corresponding(pose, source, target, limits, points)
    back, there = corresponding(pose.inv(), target, source, limits, points)
    if left_out is not None:
        stays, stay_back = ~(left_out[1][match] | left_out[0][here]), ~(left_out[0][back] | left_out[1][there])
        match, here, back, there = match[stays], here[stays], back[stay_back], there[stay_back]
    moved = pose.apply(source.points[match])
    other = pose.apply(source.points[there])
    normals = np.vstack([target.normals[here], source.normals[there] @ rotation_matrix(pose).T])
    return SurfaceGaps(
        positions=np.vstack([moved, target.points[back]]),
        normals=normals,
        gaps_m=np.concatenate(
            [
                np.einsum("ij,ij->i", target.normals[here], target.points[here] - moved),
                np.einsum("ij,ij->i", normals[len(here) :], target.points[back] - other),
            ]
        ),
        weights=np.concatenate([source.weights[match], target.weights[back]]),
        of_target=np.concatenate([here, back]),
        of_source=np.concatenate([match, there]),
    )


def _step(
    pose: RigidTransform, target: SurfaceIndex, source: SurfaceIndex, limits: EvidenceLimits, points: int
) -> RigidTransform | None:
    """Solve one weighted point-to-plane step in the target frame with both scans' planes; None if too little fits."""
    found = surface_gaps(pose, target, source, limits, points)
    if len(found.gaps_m) < LEAST_GAPS:
        return None
    return point_to_plane_step(found, DOUBTFUL_SHARE * limits.max_distance_m)


def point_to_plane_step(found: SurfaceGaps, doubtful_m: float) -> RigidTransform:
    """Solve for the small motion that closes gaps; what nothing fixes stays where it is.

    Parameters
    ----------
    found
        The gaps.
    doubtful_m
        A gap of this size counts half [m].
    """
    weights = found.weights / (1.0 + (found.gaps_m / doubtful_m) ** 2)
    centre = np.average(found.positions, axis=0, weights=weights)
    size = np.sqrt(np.average(np.sum((found.positions - centre) ** 2, axis=1), weights=weights))
    scale = np.repeat([max(float(size), 1e-3), 1.0], 3)
    solution = _solve(found.design(centre) / scale, found.gaps_m, weights) / scale
    rotation = Rotation.from_rotvec(solution[:3])
    return RigidTransform.from_components(solution[3:] + centre - rotation.apply(centre), rotation)


def _solve(design: Array, right_side: Scalars, weights: Scalars) -> Array:
    """Solve the normal equations; freedoms that the surfaces do not fix stay where they are."""
    matrix = (design * weights[:, None]).T @ design
    values, vectors = np.linalg.eigh(matrix)
    usable = values > LEAST_INFORMATION * values[-1]
    projected = vectors.T @ ((design * weights[:, None]).T @ right_side)
    return np.asarray(vectors[:, usable] @ (projected[usable] / values[usable]))
