"""Which of two poses the surfaces speak for: what fits in one of them and cannot be where the other has it.

In a building that looks like itself nearly everything fits in two poses. What tells them apart is the rest: a cupboard
on which the other scan has the same cupboard in one pose stands, in the other pose, where that scan looked through; and
a window's frame that lies on the same frame in one pose lies, in the other, a decimetre before or behind a wall that
one of them would hide. In the right pose such things can be many; in a wrong one hardly anything fits that could not be
in the right one, for everything has its place there. Things that moved between the scans fit in neither pose and say
nothing here.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags
from algorithms.scans.pose_scores import FINAL_POINTS, strict_limits
from algorithms.scans.surface_index import SurfaceIndex
from algorithms.scans.surface_outcomes import surface_outcomes

LEAST_POINTS, PER_AGAINST, MOST_BACK = 8, 2.0, 0.1
"""Of at most `FINAL_POINTS` surface points of each scan so many must fit in the one pose and be impossible in the
other; and so many times as many as are impossible in the one, whatever they do in the other; while at most the third
value times as many fit in the other pose and are impossible in the one. In 213 pairs of simulated buildings that look
like themselves no wrong pose had more than one such point to show against the right one, of 308 compared, and half of
3028 wrong ones had more than 85 against them beside the right one. Real scans hardly ever come to this comparison."""
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
        laid = surface_outcomes(motion, moved, fixed, self._limits, points=FINAL_POINTS)
        return _Laid(laid.fits, laid.looked_through | laid.beside)

    def _area_m2(self, counts: list[int]) -> float:
        """Give the area that points of both scans stand for: a square of their spacing each, for all of the scan."""
        return sum(
            count * scan.spacing_m**2 * max(len(scan.points) / FINAL_POINTS, 1.0)
            for count, scan in zip(counts, self._scans, strict=True)
        )
