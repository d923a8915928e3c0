"""Test many hypotheses of a pose, coarse to fine: support against violation of free space."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Vector3
from algorithms.matching.polish import polished
from algorithms.matching.votes import Motions
from algorithms.scans.pose_scores import FINAL_POINTS, PoseScores, score_poses, strict_limits
from algorithms.scans.surface_index import EvidenceLimits, SurfaceIndex

FIRST_POINTS, SECOND_POINTS, POLISH_POINTS = 200, 1500, 2500
SECOND_MOST, POLISH_MOST = 800, 40


@dataclass(frozen=True, eq=False)
class RankedPoses:
    """Distinct poses, the best first."""

    poses: tuple[RigidTransform, ...]
    """Target from source."""
    scores: PoseScores
    """Of these poses, in the same order."""
    tested: int
    """Hypotheses tested in all."""

    def joined(self, other: "RankedPoses", source: SurfaceIndex) -> "RankedPoses":
        """Sort in other poses of the same scans."""
        names = ("support", "violation", "overlap", "score")
        both = (np.concatenate([getattr(self.scores, name), getattr(other.scores, name)]) for name in names)
        centre = source.points.mean(axis=0)
        return _in_order((*self.poses, *other.poses), PoseScores(*both), centre, self.tested + other.tested)


def rank_hypotheses(
    hypotheses: Motions, target: SurfaceIndex, source: SurfaceIndex, *, noise_m: float, most: int = POLISH_MOST
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
    """
    base = float(np.clip(3.0 * noise_m, 0.05, 0.25))
    spacing = max(target.spacing_m, source.spacing_m)
    rough = EvidenceLimits(base + 0.2, np.radians(25.0), 2.5 * spacing, margin_m=0.4, margin_relative=0.03)
    middle = EvidenceLimits(base + 0.12, np.radians(22.0), 2.5 * spacing, margin_m=0.3, margin_relative=0.02)
    centre = source.points.mean(axis=0)
    kept = hypotheses
    for points, limits, kept_most in ((FIRST_POINTS, rough, SECOND_MOST), (SECOND_POINTS, middle, 0)):
        scores = score_poses(kept.rotations, kept.translations_m, target, source, points=points, limits=limits)
        order = np.argsort(-scores.score, kind="stable")
        if kept_most:
            kept = kept[order[:kept_most]]
        else:
            kept = kept[_distinct(kept, order, centre, angle_rad=0.05, shift_m=0.35, most=most)]
    poses = [
        polished(
            RigidTransform.from_components(translation, Rotation.from_matrix(rotation)),
            target,
            source,
            distances_m=(base + 0.25, base + 0.12, base + 0.05),
            points=POLISH_POINTS,
        )
        for rotation, translation in zip(kept.rotations, kept.translations_m, strict=True)
    ]
    final = Motions(
        np.array([pose.rotation.as_matrix() for pose in poses]).reshape(-1, 3, 3),
        np.array([pose.translation for pose in poses]).reshape(-1, 3),
        kept.votes,
    )
    scores = score_poses(
        final.rotations,
        final.translations_m,
        target,
        source,
        points=FINAL_POINTS,
        limits=strict_limits(noise_m, spacing),
    )
    return _in_order(poses, scores, centre, len(hypotheses))


def _in_order(poses: Sequence[RigidTransform], scores: PoseScores, centre: Vector3, tested: int) -> RankedPoses:
    """Sort by falling score and keep the distinct ones."""
    motions = Motions(
        np.array([pose.rotation.as_matrix() for pose in poses]).reshape(-1, 3, 3),
        np.array([pose.translation for pose in poses]).reshape(-1, 3),
        np.ones(len(poses)),
    )
    order = np.argsort(-scores.score, kind="stable")
    chosen = _distinct(motions, order, centre, angle_rad=np.radians(4.5), shift_m=0.3, most=len(poses))
    return RankedPoses(
        tuple(poses[k] for k in chosen),
        PoseScores(scores.support[chosen], scores.violation[chosen], scores.overlap[chosen], scores.score[chosen]),
        tested,
    )


def _distinct(
    motions: Motions, order: Array, centre_m: Vector3, *, angle_rad: float, shift_m: float, most: int
) -> Array:
    """Walk through the motions in the given order and keep those that differ from all kept before."""
    images = motions.rotations @ centre_m + motions.translations_m
    chosen: list[int] = []
    # |R1 - R2|^2 (Frobenius) = 8 sin^2(angle / 2)
    limit = 8.0 * np.sin(0.5 * angle_rad) ** 2
    for k in order:
        if chosen:
            turned = np.sum((motions.rotations[chosen] - motions.rotations[k]) ** 2, axis=(1, 2)) < limit
            shifted = np.linalg.norm(images[chosen] - images[k], axis=1) < shift_m
            if (turned & shifted).any():
                continue
        chosen.append(int(k))
        if len(chosen) == most:
            break
    return np.array(chosen, dtype=np.int64)
