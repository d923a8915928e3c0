"""What the surfaces of all stations say of a network: nothing may stand where another instrument looked through.

Loops need at least three registrations. Where only one connects two parts of a network, or where loops cannot tell
which of several is wrong, the stations of one part are laid on those of the other in the poses that follow, and those
that overlap most are tested like registered pairs: also such as were never registered.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.features.scan_features import ScanFeatures
from algorithms.network.candidate_pairs import CellNumbers, occupied_cells
from algorithms.quality.overlap import verify_pose
from algorithms.scans.pose_scores import balance

MOST_PAIRS = 6
"""Pairs of stations that are tested for two parts of a network: those that overlap most."""
MOST_POINTS = 2000
"""Points of a scan that tell where its surfaces are, roughly."""
CONTRADICTION_SCORE = -0.08
"""Stations with a lower score stand in each other's free space: of 158 pairs of stations in true poses, overlapping or
not, none was below 0; a station of an office shifted by 4 m along the corridor came to -0.16, -0.10 and -0.02."""
HARMLESS_SCORE = -0.02
"""Above, nothing speaks against the poses."""
CONFIRMING_SCORE = 0.3
"""A pair with such a score fits: no registration on the way between its stations is wrong."""


@dataclass(frozen=True)
class SurfaceEvidence:
    """What the surfaces of two stations say of their poses."""

    score: float
    """Share of surface that fits less the penalty for violated free space."""
    violation_share: float
    """Share of the surface that stands where the other instrument looked through."""
    stations: tuple[int, int]

    @property
    def contradicts(self) -> bool:
        """Whether the poses cannot be true."""
        return self.score < CONTRADICTION_SCORE

    @property
    def is_harmless(self) -> bool:
        """Whether nothing speaks against the poses."""
        return self.score > HARMLESS_SCORE

    @property
    def confirms(self) -> bool:
        """Whether the poses must be true."""
        return self.score >= CONFIRMING_SCORE


class SurfaceControl:
    """Tests parts of a network against each other.

    Parameters
    ----------
    features
        Gives the features of a station in its reduced frame; called again and again.
    """

    def __init__(self, features: Callable[[int], ScanFeatures]) -> None:
        self._features = features

    def between(
        self, poses: Mapping[int, RigidTransform], ones: Collection[int], others: Collection[int]
    ) -> list[SurfaceEvidence]:
        """Test the pairs of stations of two parts that overlap most; none where no two come near each other.

        Parameters
        ----------
        poses
            Of all these stations in a common frame.
        ones, others
            Stations of the two parts.
        """
        cells = {station: self._cells(station, poses[station]) for station in (*ones, *others)}
        shared = sorted(
            ((-len(np.intersect1d(cells[one], cells[other])), one, other) for one in ones for other in others),
        )[:MOST_PAIRS]
        found = []
        for count, one, other in shared:
            if count == 0:
                continue
            tested = verify_pose(self._features(one), self._features(other), poses[one].inv() * poses[other])
            if tested.free_space_known:
                weighed = float(balance(tested.support_share, tested.violation_share))
                found.append(SurfaceEvidence(weighed, tested.violation_share, (one, other)))
        return found

    def _cells(self, station: int, pose: RigidTransform) -> CellNumbers:
        points = self._features(station).surface.points
        thinned = points[:: max(len(points) // MOST_POINTS, 1)]
        return occupied_cells(np.ascontiguousarray(thinned), pose)
