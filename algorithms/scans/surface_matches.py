"""Which surface points of one scan lie on the surface of another in a pose."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags, Indices, Points
from algorithms.geometry.rotations import rotation_matrix
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex


def corresponding(
    fixed_from_moved: RigidTransform, moved: SurfaceIndex, fixed: SurfaceIndex, limits: EvidenceLimits, points: int
) -> tuple[Indices, Indices]:
    """Find which of the first `points` surface points of one scan lie on which of the other: two index arrays.

    Parameters
    ----------
    fixed_from_moved
        Pose.
    moved, fixed
        The two scans.
    limits
        What lies on the other surface.
    points
        How many surface points of `moved` to try.
    """
    m = min(points, len(moved.points))
    match = _matches(fixed_from_moved, moved.points[:m], moved.normals[:m], fixed, limits)
    found = np.flatnonzero(match >= 0)
    return found, match[found]


def fitting(
    fixed_from_moved: RigidTransform, points: Points, normals: Points, fixed: SurfaceIndex, limits: EvidenceLimits
) -> Flags:
    """Say which moved points with their normals lie on the surface of a scan.

    Parameters
    ----------
    fixed_from_moved
        Pose.
    points, normals
        (n, 3) points of the moved scan and their unit normals.
    fixed
        The other scan.
    limits
        What lies on its surface.
    """
    return np.asarray(_matches(fixed_from_moved, points, normals, fixed, limits) >= 0)


def nearest_surface(points: Points, normals: Points, fixed: SurfaceIndex, limits: EvidenceLimits) -> Indices:
    """Give the surface point of a scan that each of some points (n, 3) in its frame lies on, -1 where on none."""
    return _matches(RigidTransform.identity(), points, normals, fixed, limits)


def _matches(
    fixed_from_moved: RigidTransform, points: Points, normals: Points, fixed: SurfaceIndex, limits: EvidenceLimits
) -> Indices:
    from algorithms.scans import surface_index_kernels as kernels

    match = np.empty(len(points), dtype=np.int64)
    kernels.matched_surface(
        np.ascontiguousarray(rotation_matrix(fixed_from_moved)),
        np.ascontiguousarray(fixed_from_moved.translation, dtype=np.float64),
        np.ascontiguousarray(points.T), normals, fixed.points, fixed.normals, fixed.owner, fixed.low_m, fixed.cell_m,
        limits.as_array(), match,
    )  # fmt: skip
    return match
