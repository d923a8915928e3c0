"""What becomes of the surface of one scan where a pose lays it into another, point by point.

A surface point *fits* where the other scan has surface with an agreeing normal. It was *looked through* where the other
instrument saw something clearly farther away. It is *beside* parallel surface of the other scan where one of the two
would have to hide the other and did not: a window's frame a decimetre before a wall. Of all other points, hidden ones
and those that lie where the other instrument saw nothing, the pose says nothing.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex, seen_through
from algorithms.scans.surface_matches import corresponding, fitting

BESIDE_M = 0.5
"""Surface beside parallel surface is looked at up to this far off it [m], and no farther than the raster of the nearest
surface reaches, two cells (0.3 m where surface points stand 0.1 m apart); farther off, free space tells."""
SIGHT_REACH = 1.0
"""A line of sight runs through surface where points of it are so near on every side, in spacings. A place so far past
the rim of an opening would count with points on one side alone, and what is seen through the opening would refute."""


@dataclass(frozen=True, eq=False)
class SurfaceOutcomes:
    """What becomes of n surface points of a scan; no two are true of one point."""

    fits: Flags
    """(n,) True for points that lie on the other scan's surface."""
    looked_through: Flags
    """(n,) True where the other instrument looked through; none where its position is unknown."""
    beside: Flags
    """(n,) True beside parallel surface; none where the position of either instrument is unknown."""


def surface_outcomes(
    fixed_from_moved: RigidTransform,
    moved: SurfaceIndex,
    fixed: SurfaceIndex,
    limits: EvidenceLimits,
    *,
    points: int,
    across_m: float = 0.0,
) -> SurfaceOutcomes:
    """Lay the first `points` surface points of one scan into the other. O(n).

    Parameters
    ----------
    fixed_from_moved
        Pose between the reduced frames.
    moved, fixed
        The two scans.
    limits
        What fits, and the margins of free space.
    points
        How many surface points of `moved` to try.
    across_m
        Looked through is only what has the surface seen behind it farther than this off its own plane [m].
    """
    m = min(points, len(moved.points))
    places, normals = moved.points[:m], moved.normals[:m]
    fits = fitting(fixed_from_moved, places, normals, fixed, limits)
    through = seen_through(fixed_from_moved, places, normals, fixed, limits, across_m=across_m) & ~fits
    beside = stands_beside(fixed_from_moved, moved, fixed, limits, points=m) & ~fits & ~through
    return SurfaceOutcomes(fits, through, beside)


def stands_beside(
    fixed_from_moved: RigidTransform, moved: SurfaceIndex, fixed: SurfaceIndex, limits: EvidenceLimits, *, points: int
) -> Flags:
    """Say which of the first `points` surface points stand beside parallel surface that would hide them, or that they
    would hide.

    What stands before a surface hides it from the instrument that saw the surface, what stands behind it is hidden from
    the instrument that saw the point: in either case a line of sight would run through surface. What is seen through an
    opening, or past a rim, is not.

    Parameters
    ----------
    fixed_from_moved
        Pose between the reduced frames.
    moved, fixed
        The two scans.
    limits
        What lies on a surface.
    points
        How many surface points of `moved` to try.
    """
    beside = np.zeros(min(points, len(moved.points)), dtype=bool)
    if not (moved.knows_free_space and fixed.knows_free_space):
        return beside
    found, match = corresponding(fixed_from_moved, moved, fixed, replace(limits, max_distance_m=BESIDE_M), points)
    places, normals, feet = fixed_from_moved.apply(moved.points[found]), fixed.normals[match], fixed.points[match]
    depth = np.einsum("ij,ij->i", normals, places - feet)
    eyes = np.where((depth > 0.0)[:, None], fixed.sensor_m, fixed_from_moved.apply(moved.sensor_m))
    height = np.einsum("ij,ij->i", normals, eyes - feet)
    facing = height > np.maximum(depth, 0.0)
    crossed = eyes + (height / np.where(facing, height - depth, np.inf))[:, None] * (places - eyes)
    across = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
    across *= SIGHT_REACH * fixed.spacing_m / np.linalg.norm(across, axis=1, keepdims=True)
    upwards = np.cross(normals, across)
    here, near = RigidTransform.identity(), replace(limits, reach_m=SIGHT_REACH * fixed.spacing_m)
    beside[found] = facing & np.logical_and.reduce(
        [fitting(here, crossed + aside, normals, fixed, near) for aside in (across, -across, upwards, -upwards)]
    )
    return beside
