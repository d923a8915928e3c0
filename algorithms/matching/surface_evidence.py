"""Which of two poses the surfaces speak for: what fits in one of them and cannot be where the other has it.

In a building that looks like itself nearly everything fits in two poses. What tells them apart is the rest: a cupboard
on which the other scan has the same cupboard in one pose stands, in the other pose, where that scan looked through; and
a window's frame that lies on the same frame in one pose lies, in the other, a decimetre beside a wall. In the right
pose such things can be many; in a wrong one hardly anything fits that could not be in the right one, for everything has
its place there. Things that moved between the scans fit in neither pose and say nothing here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags
from algorithms.matching.polish import fitting
from algorithms.scans.pose_scores import FINAL_POINTS, strict_limits
from algorithms.scans.surface_index import SurfaceIndex, seen_through

LEAST_THROUGH, THROUGH_PER_AGAINST, MOST_THROUGH_BACK = 6, 2.0, 0.1
"""Of at most `FINAL_POINTS` surface points of each scan so many must fit in the one pose and stand, in the other, where
the other instrument looked through; and so many times as many as stand in free space in the one, whatever they do in
the other; while at most the third part as many fit in the other pose and stand in free space in the one. In 300 pairs
of simulated buildings, most of them regular, no wrong pose had more than two such points to show against the right one,
of 1650 compared; in a street whose reference is bent 11, with 29 against the pose."""
LEAST_BESIDE, BESIDE_PER_AGAINST, MOST_BESIDE_BACK, BESIDE_M = 100, 5.0, 0.05, 0.5
"""The same where surface beside parallel surface, off it by no more than the last value [m], counts like surface in
free space. Right poses show some as well: frames, reveals and shelves that only one instrument saw; so it must be more.
In a corridor with recessed doors a wrong pose came to half of what the second value asks, and in a room that a half
turn lays on itself one had 38 points to show against the right one and none the other way round."""
LEAST_M2 = 0.1
"""So much surface it must be in either case: where points stand close together a few of them are a hand's breadth."""


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
    through: Flags
    """(n,) True for points where the other instrument looked through."""
    amiss: Flags
    """(n,) True for these, and for points beside parallel surface of the other scan."""


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
        here, there = self._laid(pose), self._laid(other)
        found = self._compared(
            [(a.fits, a.through, b.fits, b.through) for a, b in zip(here, there, strict=True)],
            LEAST_THROUGH, THROUGH_PER_AGAINST, MOST_THROUGH_BACK,
        )  # fmt: skip
        return found or self._compared(
            [(a.fits, a.amiss, b.fits, b.amiss) for a, b in zip(here, there, strict=True)],
            LEAST_BESIDE, BESIDE_PER_AGAINST, MOST_BESIDE_BACK,
        )  # fmt: skip

    def _compared(
        self, scans: Sequence[tuple[Flags, Flags, Flags, Flags]], least: int, per_against: float, most_back: float
    ) -> SurfaceEvidence | None:
        """Compare what fits and what cannot be here, what fits and what cannot be there, scan by scan."""
        for_here = [int(np.count_nonzero(fits & wrong_there)) for fits, _, _, wrong_there in scans]
        for_there = [int(np.count_nonzero(wrong & fits_there)) for _, wrong, fits_there, _ in scans]
        against = sum(int(np.count_nonzero(wrong)) for _, wrong, _, _ in scans)
        if sum(for_here) < max(least, per_against * against) or sum(for_there) > most_back * sum(for_here):
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
        beside = fitting(motion, points, normals, fixed, replace(self._limits, max_distance_m=BESIDE_M))
        through = ~fits & seen_through(motion, points, normals, fixed, self._limits)
        return _Laid(fits, through, through | (beside & ~fits))

    def _area_m2(self, counts: list[int]) -> float:
        """Give the area that points of both scans stand for: a square of their spacing each, for all of the scan."""
        return sum(
            count * scan.spacing_m**2 * max(len(scan.points) / FINAL_POINTS, 1.0)
            for count, scan in zip(counts, self._scans, strict=True)
        )
