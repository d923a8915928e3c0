"""Which of two poses the surfaces speak for: what fits in one of them and cannot be where the other has it.

In a building that looks like itself nearly everything fits in two poses. What tells them apart is the rest: a cupboard
on which the other scan has the same cupboard in one pose stands, in the other pose, where that scan looked through; and
a window's frame that lies on the same frame in one pose lies, in the other, a decimetre before or behind a wall that
one of them would hide. In the right pose such things can be many; in a wrong one hardly anything fits that could not be
in the right one, for everything has its place there. Things that moved between the scans fit in neither pose and say
nothing here.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags
from algorithms.scans.pose_scores import FINAL_POINTS, strict_limits
from algorithms.scans.surface_index import SurfaceIndex, seen_through
from algorithms.scans.surface_matches import corresponding, fitting

LEAST_POINTS, PER_AGAINST, MOST_BACK = 8, 2.0, 0.1
"""Of at most `FINAL_POINTS` surface points of each scan so many must fit in the one pose and be impossible in the
other; and so many times as many as are impossible in the one, whatever they do in the other; while at most the third
value times as many fit in the other pose and are impossible in the one. In 213 pairs of simulated buildings that look
like themselves no wrong pose had more than one such point to show against the right one, of 308 compared, and half of
3028 wrong ones had more than 85 against them beside the right one. Real scans hardly ever come to this comparison."""
BESIDE_M = 0.5
"""Surface beside parallel surface is looked at up to this far off it [m], and no farther than the raster of the nearest
surface reaches, two cells (0.3 m where surface points stand 0.1 m apart); farther off, free space tells."""
SIGHT_REACH = 1.0
"""A line of sight runs through surface where points of it are so near on every side, in spacings. A place so far past
the rim of an opening would count with points on one side alone, and what is seen through the opening would refute."""
LEAST_M2 = 0.1
"""So much surface it must be: where points stand close together a few of them are a hand's breadth."""


@dataclass(frozen=True)
class SurfaceEvidence:
    """What fits in one pose and cannot be where another has it, and the other way round."""

    here_m2: float
    """Surface of both scans that fits here and cannot be there, roughly [m2]."""
    there_m2: float
    """Surface of both scans that fits there and cannot be here, roughly [m2]."""


@dataclass(frozen=True, eq=False)
class _Laid:
    """What becomes of the surface points of one scan where a pose lays them into the other."""

    fits: Flags
    """(n,) True for points that lie on the other scan's surface."""
    impossible: Flags
    """(n,) True for points where the other instrument looked through, and for those beside parallel surface of the
    other scan where one of the two would have to hide the other and did not."""


class SurfaceWitness:
    """Two scans whose surfaces are asked about pairs of poses; what one pose shows is remembered. O(n) a pose."""

    def __init__(self, target: SurfaceIndex, source: SurfaceIndex, noise_m: float) -> None:
        """Prepare both scans.

        Parameters
        ----------
        target, source
            The two scans.
        noise_m
            Standard deviation of single points [m].
        """
        self._scans = (target, source)
        self._limits = strict_limits(noise_m, max(target.spacing_m, source.spacing_m))
        self._known: dict[bytes, tuple[_Laid, _Laid]] = {}

    def refutation(self, pose: RigidTransform, other: RigidTransform) -> SurfaceEvidence | None:
        """Show that another pose is wrong by surface that fits in the first and cannot be there in it, or give None.

        Parameters
        ----------
        pose, other
            Target from source, between the reduced frames.
        """
        scans = list(zip(self._laid(pose), self._laid(other), strict=True))
        for_here = [int(np.count_nonzero(here.fits & there.impossible)) for here, there in scans]
        for_there = [int(np.count_nonzero(here.impossible & there.fits)) for here, there in scans]
        against = sum(int(np.count_nonzero(here.impossible)) for here, _ in scans)
        if sum(for_here) < max(LEAST_POINTS, PER_AGAINST * against) or sum(for_there) > MOST_BACK * sum(for_here):
            return None
        found = SurfaceEvidence(self._area_m2(for_here), self._area_m2(for_there))
        return found if found.here_m2 >= LEAST_M2 else None

    def _laid(self, pose: RigidTransform) -> tuple[_Laid, _Laid]:
        """Lay the target's surface into the source, and the source's into the target."""
        key = pose.as_matrix().tobytes()
        if key not in self._known:
            target, source = self._scans
            self._known[key] = self._one(target, source, pose.inv()), self._one(source, target, pose)
        return self._known[key]

    def _one(self, moved: SurfaceIndex, fixed: SurfaceIndex, motion: RigidTransform) -> _Laid:
        points, normals = moved.points[:FINAL_POINTS], moved.normals[:FINAL_POINTS]
        fits = fitting(motion, points, normals, fixed, self._limits)
        impossible = seen_through(motion, points, normals, fixed, self._limits) | self._beside(moved, fixed, motion)
        return _Laid(fits, impossible & ~fits)

    def _beside(self, moved: SurfaceIndex, fixed: SurfaceIndex, motion: RigidTransform) -> Flags:
        """Say which points stand beside parallel surface that would hide them, or that they would hide.

        What stands before a surface hides it from the instrument that saw the surface, what stands behind it is hidden
        from the instrument that saw the point: in either case a line of sight would run through surface. What is seen
        through an opening, or past a rim, is not.
        """
        beside = np.zeros(min(FINAL_POINTS, len(moved.points)), dtype=bool)
        if not (moved.knows_free_space and fixed.knows_free_space):
            return beside
        found, match = corresponding(motion, moved, fixed, replace(self._limits, max_distance_m=BESIDE_M), FINAL_POINTS)
        points, normals, feet = motion.apply(moved.points[found]), fixed.normals[match], fixed.points[match]
        depth = np.einsum("ij,ij->i", normals, points - feet)
        eyes = np.where((depth > 0.0)[:, None], fixed.sensor_m, motion.apply(moved.sensor_m))
        height = np.einsum("ij,ij->i", normals, eyes - feet)
        facing = height > np.maximum(depth, 0.0)
        crossed = eyes + (height / np.where(facing, height - depth, np.inf))[:, None] * (points - eyes)
        across = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
        across *= SIGHT_REACH * fixed.spacing_m / np.linalg.norm(across, axis=1, keepdims=True)
        upwards = np.cross(normals, across)
        here, limits = RigidTransform.identity(), replace(self._limits, reach_m=SIGHT_REACH * fixed.spacing_m)
        beside[found] = facing & np.logical_and.reduce(
            [fitting(here, crossed + aside, normals, fixed, limits) for aside in (across, -across, upwards, -upwards)]
        )
        return beside

    def _area_m2(self, counts: list[int]) -> float:
        """Give the area that points of both scans stand for: a square of their spacing each, for all of the scan."""
        return sum(
            count * scan.spacing_m**2 * max(len(scan.points) / FINAL_POINTS, 1.0)
            for count, scan in zip(counts, self._scans, strict=True)
        )
