"""Test many hypotheses of a pose, coarse to fine: support against violation of free space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Vector3
from algorithms.matching.settling import settled
from algorithms.matching.votes import Motions, motions_of
from algorithms.scans.pose_scores import FINAL_POINTS, PoseScores, score_poses, strict_limits
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex

ROUGH_SIFTS, MIDDLE_POINTS = ((64, 3000), (200, 400)), 1500
"""Surface points of each scan, and how many poses go on."""
FINE_SIFTS = ((400, 300),)
"""The same for hypotheses of poses in which little of the surface fits: few points would meet none of it."""
SETTLED_FIRST, SETTLED_POINTS = 150, 1500
"""So many of hypotheses that are good to half a cell only are settled before they are compared on more points: a right
one 0.2 m off lies on nothing that is seen through a door."""
POLISH_POINTS, POLISH_MOST = 2500, 40
WEIGHED_BY_SCORE, WEIGHED_BY_CLEANNESS, LEAST_SUPPORT_TO_WEIGH = 16, 6, 0.02
"""So many poses are worth weighing by score, and so many more by how little speaks against them..."""
CLEANNESS = 60.0
"""...each per cent of all surface that stands in free space taking this share of a per cent off what fits."""


@dataclass(frozen=True, eq=False)
class RankedPoses:
    """Distinct poses, the best first."""

    poses: tuple[RigidTransform, ...]
    """Target from source."""
    scores: PoseScores
    """Of these poses, in the same order."""
    tested: int
    """Hypotheses tested in all."""

    def worth_weighing(self) -> list[int]:
        """Give the numbers of the poses of which the evidence is worth counting: by score, and by little against."""
        support, violation = self.scores.support, self.scores.violation
        by_score = np.argsort(-self.scores.charitable, kind="stable")[:WEIGHED_BY_SCORE]
        by_cleanness = np.argsort(-support * np.exp(-CLEANNESS * violation), kind="stable")[:WEIGHED_BY_CLEANNESS]
        return [
            k
            for k in dict.fromkeys([*by_score.tolist(), *by_cleanness.tolist()])
            if support[k] >= LEAST_SUPPORT_TO_WEIGH
        ]

    def joined(self, other: "RankedPoses", source: SurfaceIndex) -> "RankedPoses":
        """Sort in other poses of the same scans."""
        names = ("support", "violation", "overlap", "score")
        both = (np.concatenate([getattr(self.scores, name), getattr(other.scores, name)]) for name in names)
        centre = source.centre_m
        return _in_order((*self.poses, *other.poses), PoseScores(*both), centre, self.tested + other.tested)


def rank_hypotheses(
    hypotheses: Motions,
    target: SurfaceIndex,
    source: SurfaceIndex,
    *,
    noise_m: float,
    most: int = POLISH_MOST,
    sifts: Sequence[tuple[int, int]] = ROUGH_SIFTS,
    settle_first: bool = False,
) -> RankedPoses:
    """Sift hypotheses coarse to fine, polish the best, and give the distinct ones by falling score.

    Parameters
    ----------
    hypotheses
        Motions target from source to try.
    target, source
        The two scans.
    noise_m
        Standard deviation of single points [m]; widens the limits.
    most
        So many distinct ones are polished.
    sifts
        Surface points of each scan, and how many poses go on, step by step.
    settle_first
        Whether the hypotheses are so rough that those left are settled before they are compared any further.
    """
    base = float(np.clip(3.0 * noise_m, 0.05, 0.25))
    spacing = max(target.spacing_m, source.spacing_m)
    rough = EvidenceLimits(base + 0.2, np.radians(25.0), 2.5 * spacing, margin_m=0.4, margin_relative=0.03)
    middle = EvidenceLimits(base + 0.12, np.radians(22.0), 2.5 * spacing, margin_m=0.3, margin_relative=0.02)
    kept = hypotheses
    for points, kept_most in sifts:
        kept = _by_score(kept, target, source, points, rough)[:kept_most]
    if settle_first:
        kept = settled(kept[:SETTLED_FIRST], target, source, distances_m=(base + 0.25,), points=SETTLED_POINTS)
    kept = _by_score(kept, target, source, MIDDLE_POINTS, middle)
    centre = source.centre_m
    kept = kept[_distinct(kept, centre, angle_rad=0.05, shift_m=0.35, most=most)]
    kept = settled(kept, target, source, distances_m=(base + 0.25, base + 0.12, base + 0.05), points=POLISH_POINTS)
    scores = score_poses(
        kept.rotations,
        kept.translations_m,
        target,
        source,
        points=FINAL_POINTS,
        limits=strict_limits(noise_m, spacing),
    )
    return _in_order(kept.poses, scores, centre, len(hypotheses))


def _by_score(
    motions: Motions, target: SurfaceIndex, source: SurfaceIndex, points: int, limits: EvidenceLimits
) -> Motions:
    """Sort by falling score, hopeless ones roughly."""
    scores = score_poses(
        motions.rotations, motions.translations_m, target, source, points=points, limits=limits, sifting=True
    )
    return motions[np.argsort(-scores.score, kind="stable")]


def _in_order(poses: Sequence[RigidTransform], scores: PoseScores, centre: Vector3, tested: int) -> RankedPoses:
    """Sort by falling score and keep the distinct ones."""
    order = np.argsort(-scores.score, kind="stable")
    chosen = order[_distinct(motions_of(poses)[order], centre, angle_rad=np.radians(4.5), shift_m=0.3, most=len(poses))]
    return RankedPoses(
        tuple(poses[k] for k in chosen),
        PoseScores(scores.support[chosen], scores.violation[chosen], scores.overlap[chosen], scores.score[chosen]),
        tested,
    )


def _distinct(motions: Motions, centre_m: Vector3, *, angle_rad: float, shift_m: float, most: int) -> Array:
    """Walk through the motions in their order and keep those that differ from all kept before."""
    images = motions.rotations @ centre_m + motions.translations_m
    chosen: list[int] = []
    # |R1 - R2|^2 (Frobenius) = 8 sin^2(angle / 2)
    limit = 8.0 * np.sin(0.5 * angle_rad) ** 2
    for k in range(len(motions)):
        if chosen:
            turned = np.sum((motions.rotations[chosen] - motions.rotations[k]) ** 2, axis=(1, 2)) < limit
            shifted = np.linalg.norm(images[chosen] - images[k], axis=1) < shift_m
            if (turned & shifted).any():
                continue
        chosen.append(k)
        if len(chosen) == most:
            break
    return np.array(chosen, dtype=np.int64)
