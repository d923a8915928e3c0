"""Verify a pose: surfaces must lie in each other, and nothing may stand in space that was seen through."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Indices, Points, Scalars
from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.geometry.rotations import rotation_matrix
from algorithms.quality.acceptance import Verification
from algorithms.quality.control import controlled_area_m2
from algorithms.quality.unexplained import MOST_PIECES, unexplained_pieces
from algorithms.scans.pose_scores import FINAL_POINTS, score_poses, strict_limits

NEAR_M, FAR_M = 0.1, 0.5
"""Distances of the two overlap figures [m]."""


def verify_pose(target: ScanFeatures, source: ScanFeatures, target_from_source: RigidTransform) -> Verification:
    """Measure overlap, fit and violation of free space of a (refined) pose.

    Parameters
    ----------
    target, source
        Features of the two scans; their thinned surfaces are used.
    target_from_source
        Pose in the reduced frames [m].
    """
    indices = (target.index, source.index)
    noise = max(target.noise_std_m, source.noise_std_m)
    spacing = max(index.spacing_m for index in indices)
    limits = strict_limits(noise, spacing)
    scores = score_poses(
        rotation_matrix(target_from_source)[None],
        np.asarray(target_from_source.translation, dtype=np.float64)[None],
        indices[0],
        indices[1],
        points=FINAL_POINTS,
        limits=limits,
    )
    forward = surface_distances(target.surface, source.surface, target_from_source)
    backward = surface_distances(source.surface, target.surface, target_from_source.inv())
    of_source, of_target = (np.hypot(off, aside) <= NEAR_M for off, aside in (forward, backward))
    pieces = [
        *unexplained_pieces(
            source, target, target_from_source, limits, explained=of_source[indices[1].numbers], in_target=False
        ),
        *unexplained_pieces(
            target, source, target_from_source.inv(), limits, explained=of_target[indices[0].numbers], in_target=True
        ),
    ]
    shares = [
        max(float(np.mean(np.hypot(off, aside) <= limit)) for off, aside in (forward, backward))
        for limit in (NEAR_M, FAR_M)
    ]
    offsets = np.concatenate([off[np.hypot(off, aside) <= NEAR_M] for off, aside in (forward, backward)])
    return Verification(
        overlap_decimetre=shares[0],
        overlap_half_metre=shares[1],
        rms_m=float(np.sqrt(np.mean(offsets**2))) if len(offsets) else 0.0,
        support_share=float(scores.support[0]),
        violation_share=float(scores.violation[0]),
        score=float(scores.score[0]),
        free_space_known=all(index.knows_free_space for index in indices),
        controlled_m2=controlled_area_m2(target, source, target_from_source, limits),
        unexplained=tuple(sorted(pieces, key=lambda piece: -piece.area_m2)[:MOST_PIECES]),
    )


def surface_distances(
    fixed: SurfaceSample, moved: SurfaceSample, fixed_from_moved: RigidTransform
) -> tuple[Scalars, Scalars]:
    """Measure how far the points of one thinned surface are from another.

    Parameters
    ----------
    fixed, moved
        Thinned surfaces.
    fixed_from_moved
        Pose.

    Returns
    -------
    off
        (n,) distance of each moved point from the tangent plane of the nearest point [m]; the distance itself where
        that has no normal; inf where nothing is within a metre or so.
    aside
        (n,) distance along that plane beyond the disc the nearest point stands for (0.75 voxels) [m].
    """
    if len(fixed.points) == 0 or len(moved.points) == 0:
        return np.full(len(moved.points), np.inf), np.full(len(moved.points), np.inf)
    points = fixed_from_moved.apply(moved.points)
    # what is farther matters to no figure, and looking for it takes most of the time where scans hardly overlap
    reach = 2.0 * (FAR_M + fixed.voxel_size_m)
    lengths, found = cKDTree(fixed.points).query(points, distance_upper_bound=reach)
    nearest = np.asarray(found, dtype=np.int64)
    near = np.flatnonzero(np.isfinite(lengths))
    off, aside = np.full(len(points), np.inf), np.full(len(points), np.inf)
    off[near], aside[near] = _apart(fixed, points[near], nearest[near])
    return off, aside


def _apart(fixed: SurfaceSample, points: Points, nearest: Indices) -> tuple[Scalars, Scalars]:
    normals = fixed.normals[nearest]
    differences = points - fixed.points[nearest]
    off = np.abs(np.einsum("ij,ij->i", differences, normals))
    lengths = np.linalg.norm(differences, axis=1)
    aside = np.maximum(np.sqrt(np.maximum(lengths**2 - off**2, 0.0)) - 0.75 * fixed.voxel_size_m, 0.0)
    flat = np.einsum("ij,ij->i", normals, normals) > 0.5
    return np.where(flat, off, lengths), np.where(flat, aside, 0.0)
