"""Where the source stands: how probable the pose that was found is, beside others and beside none of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Vector3
from algorithms.evidence.calibration import Calibration
from algorithms.evidence.log_odds import Counts, Weights, log_odds, of_impossible
from algorithms.evidence.patches import PATCH_M
from algorithms.evidence.pose_evidence import PairEvidence, Piece
from algorithms.evidence.posterior import likeness_of, posterior
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.rotations import rotation_matrix
from algorithms.matching.directions import comes_first
from algorithms.scans.pose_scores import score_poses, strict_limits

LIKE_POINTS = 3000
"""Surface points with which a scan is laid on itself by the motion between two poses."""
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
    repeats: bool
    """Whether the building may look like itself there; else the pose is as probable as its evidence says."""


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
    """What it says of the pose; negative."""


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
    fits: float
    """Log-odds for the pose by pieces of surface that fit."""
    impossible: float
    """By pieces that stand in free space or beside surface; never positive."""
    lines: float
    """By lines that should have been seen."""
    features: float
    """By lines and planes in common and what they determine."""
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
    parts = log_odds(Counts.of([counted.of(pose) for pose in poses]), calibration.weights)
    total = parts.total
    best = int(np.argmax(total))
    like = self_likeness(poses, poses[best : best + 1], target, source)[:, 0]
    found = posterior(parts, likeness_of(like[:, 0::2], like[:, 1::2]), calibration.weights)
    at_most = 1.0 - calibration.upper_95
    onto, back = RigidTransform.from_translation(target.origin_m), RigidTransform.from_translation(-source.origin_m)
    by_evidence = found.poses[best] * np.exp(total - total[best])
    others = [
        OtherPlace(
            onto * poses[k] * back,
            float(found.poses[k]),
            float(total[k]),
            bool(found.poses[k] > by_evidence[k]),
        )
        for k in np.argsort(-found.poses, kind="stable").tolist()
        if k and found.poses[k] >= LEAST_PROBABILITY
    ]
    return Place(
        probability=min(float(found.poses[0]), at_most),
        at_most=at_most,
        others=tuple(others),
        elsewhere=found.elsewhere,
        none=found.none,
        fits=float(parts.fits[0]),
        impossible=float(parts.impossible[0]),
        lines=float(parts.lines[0]),
        features=float(parts.features[0]),
        chosen=float(parts.chosen[0]),
        against=_against(counted.impossible(poses[0]), (target, source), calibration.weights),
        calibration=calibration,
    )


def _against(
    pieces: Sequence[Piece], scans: tuple[ScanFeatures, ScanFeatures], weights: Weights
) -> tuple[PieceAgainst, ...]:
    through, beside = (np.array([getattr(each, name) for each in pieces]) for name in ("through", "beside"))
    said = of_impossible(through, beside, weights).tolist()
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


def self_likeness(
    poses: Sequence[RigidTransform], bases: Sequence[RigidTransform], target: ScanFeatures, source: ScanFeatures
) -> Array:
    """Lay each scan on itself by the motion from each base to each pose.

    Returns
    -------
    (h, b, 4): support and violation of the target, and of the source; zero where pose and base are the same.
    """
    found = np.zeros((len(poses), len(bases), 4))
    pairs = [(i, j) for i in range(len(poses)) for j in range(len(bases)) if poses[i] is not bases[j]]
    if not pairs:
        return found
    noise_m = max(target.noise_std_m, source.noise_std_m)
    for first, scan in ((0, target), (2, source)):
        motions = [poses[i] * bases[j].inv() if first == 0 else bases[j].inv() * poses[i] for i, j in pairs]
        scores = score_poses(
            np.array([rotation_matrix(motion) for motion in motions]),
            np.array([motion.translation for motion in motions]),
            scan.index,
            scan.index,
            points=LIKE_POINTS,
            limits=strict_limits(noise_m, scan.index.spacing_m),
        )
        where = tuple(np.array(pairs).T)
        found[(*where, first)], found[(*where, first + 1)] = scores.support, scores.violation
    return found
