"""Where the source stands: how probable the pose that was found is, beside others and beside none of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Vector3
from algorithms.evidence.calibration import Calibration
from algorithms.evidence.log_odds import Counts, Weights, log_odds, of_impossible
from algorithms.evidence.patches import PATCH_M
from algorithms.evidence.pose_evidence import PairEvidence, Piece, PoseEvidence
from algorithms.evidence.posterior import posterior
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.directions import comes_first

LEAST_PROBABILITY = 1e-4
"""Less probable poses are not named."""


@dataclass(frozen=True, eq=False)
class OtherPlace:
    """Another pose that is possible."""

    target_from_source: RigidTransform
    """Between the files' full coordinates."""
    probability: float
    log_odds: float
    """Against chance."""


@dataclass(frozen=True, eq=False)
class PieceAgainst:
    """A connected piece of surface that cannot be where the pose puts it."""

    in_target: bool
    """Whether the target scan shows it; else the source."""
    centre_m: Vector3
    """(3,) its middle in the coordinates of the file of the scan that shows it [m]."""
    area_m2: float
    """About how much surface it is."""
    log_odds: float
    """What the pose would gain were it not there; negative."""


@dataclass(frozen=True, eq=False)
class Place:
    """What the evidence says of the pose that was found; probabilities sum to one before they are capped."""

    probability: float
    """That it is the right one, never above `at_most`."""
    at_most: float
    """What the pairs can carry that the constants were calibrated with."""
    others: tuple[OtherPlace, ...]
    """Other poses, the most probable first."""
    elsewhere: float
    """Of another place that looks like this one and that neither scan shows."""
    none: float
    """Of none of these: the scans have nothing in common, or the right pose was not found."""
    free_space: float
    """Log-odds for the pose by patches of surface that fit beside those that were looked through."""
    beside: float
    """By those that fit beside those beside parallel surface."""
    pieces: float
    """By the number of pieces that fit and of those that cannot be where they are."""
    determined: float
    """By how well what fits determines the pose."""
    ahead: float
    """By how far it is ahead of the next pose; negative where another one is better."""
    usual: float
    """By what is usual for poses of this pair."""
    chosen: float
    """For having been chosen out of all; negative."""
    against: tuple[PieceAgainst, ...]
    """The pieces that speak against it, what says most first."""
    calibration: Calibration

    def exchanged(self) -> "Place":
        """Give the same with target and source exchanged."""
        others = [replace(each, target_from_source=each.target_from_source.inv()) for each in self.others]
        against = [replace(each, in_target=not each.in_target) for each in self.against]
        return replace(self, others=tuple(others), against=tuple(against))


def place_of(
    target: ScanFeatures, source: ScanFeatures, poses: Sequence[RigidTransform], calibration: Calibration
) -> Place:
    """Weigh the evidence of poses. O(n h) for n surface points and h poses, some hundredths of a second each.

    Parameters
    ----------
    target, source
        Features of both scans.
    poses
        Target from source between the reduced frames; the first is the one that is asked about, the others are clearly
        different ones.
    calibration
        Constants, and what they were fitted on.
    """
    if not comes_first(target, source):
        return place_of(source, target, [pose.inv() for pose in poses], calibration).exchanged()
    counted = PairEvidence(target, source)
    shown = [counted.of(pose) for pose in poses]
    parts = log_odds(Counts.of(shown), calibration.weights)
    total = parts.total
    found = posterior(total, calibration.weights.elsewhere)
    at_most = 1.0 - calibration.upper_95
    onto, back = RigidTransform.from_translation(target.origin_m), RigidTransform.from_translation(-source.origin_m)
    others = [
        OtherPlace(onto * poses[k] * back, float(found.poses[k]), float(total[k]))
        for k in np.argsort(-found.poses, kind="stable").tolist()
        if k and found.poses[k] >= LEAST_PROBABILITY
    ]
    return Place(
        probability=min(float(found.poses[0]), at_most),
        at_most=at_most,
        others=tuple(others),
        elsewhere=found.elsewhere,
        none=found.none,
        free_space=float(parts.free_space[0]),
        beside=float(parts.beside[0]),
        pieces=float(parts.pieces[0]),
        determined=float(parts.determined[0]),
        ahead=float(parts.ahead[0]),
        usual=float(parts.usual[0]),
        chosen=float(parts.chosen[0]),
        against=_against(counted.impossible(poses[0]), shown[0], (target, source), calibration.weights),
        calibration=calibration,
    )


def _against(
    pieces: Sequence[Piece], pose: PoseEvidence, scans: tuple[ScanFeatures, ScanFeatures], weights: Weights
) -> tuple[PieceAgainst, ...]:
    through, beside = (np.array([getattr(each, name) for each in pieces]) for name in ("through", "beside"))
    said = of_impossible(through, beside, pose, weights).tolist()
    found = [
        PieceAgainst(
            each.in_target,
            each.centre_m + scans[0 if each.in_target else 1].origin_m,
            (each.through + each.beside) * PATCH_M**2,
            value,
        )
        for each, value in zip(pieces, said, strict=True)
    ]
    return tuple(sorted(found, key=lambda piece: piece.log_odds))
