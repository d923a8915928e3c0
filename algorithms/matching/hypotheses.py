"""Test many hypotheses of a pose, coarse to fine: support against violation of free space."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Scalars, Vector3
from algorithms.matching.polish import polished
from algorithms.matching.surface_index import Evidence, EvidenceLimits, SurfaceIndex, evidence_of
from algorithms.matching.votes import Motions

VIOLATION_FLOOR = 0.01
"""Share of the moved surface in free space that the true pose may show: moved objects, mixed pixels, margins."""
VIOLATION_PENALTY = 8.0
"""How much support a share of violation above the floor costs."""
FIRST_POINTS, SECOND_POINTS, LAST_POINTS, POLISH_POINTS = 200, 1500, 8000, 2500
SECOND_MOST, POLISH_MOST = 800, 40


@dataclass(frozen=True, eq=False)
class PoseScores:
    """What speaks for and against h poses, both scans laid into each other."""

    support: Scalars
    """(h,) mean of both scans' shares that fit, 0..1."""
    violation: Scalars
    """(h,) mean of both scans' shares in the other's free space, 0..1."""
    overlap: Scalars
    """(h,) larger of both scans' shares that fit: the smaller scan decides."""
    score: Scalars
    """(h,) support minus the penalty for violation above the floor."""


@dataclass(frozen=True, eq=False)
class RankedPoses:
    """Distinct poses, the best first."""

    poses: tuple[RigidTransform, ...]
    """Target from source."""
    scores: PoseScores
    """Of these poses, in the same order."""
    tested: int
    """Hypotheses tested in all."""


def score_poses(
    rotations: Array,
    translations_m: Array,
    target: SurfaceIndex,
    source: SurfaceIndex,
    *,
    points: int,
    limits: EvidenceLimits,
) -> PoseScores:
    """Score poses target from source by laying each scan's surface into the other.

    Parameters
    ----------
    rotations, translations_m
        (h, 3, 3) and (h, 3).
    target, source
        The two scans.
    points
        Surface points of each scan to try.
    limits
        What fits and what violates.
    """
    forward = evidence_of(rotations, translations_m, source, target, points=points, limits=limits)
    back_rotations = np.swapaxes(rotations, 1, 2)
    back_translations = -np.einsum("hij,hj->hi", back_rotations, translations_m)
    backward = evidence_of(back_rotations, back_translations, target, source, points=points, limits=limits)
    return _scores(forward, backward)


def rank_hypotheses(hypotheses: Motions, target: SurfaceIndex, source: SurfaceIndex, *, noise_m: float) -> RankedPoses:
    """Sift hypotheses coarse to fine, polish the best, and give the distinct ones by falling score.

    Parameters
    ----------
    hypotheses
        Motions target from source to try.
    target, source
        The two scans.
    noise_m
        Standard deviation of single points [m]; widens the limits.
    """
    base = float(np.clip(3.0 * noise_m, 0.05, 0.25))
    spacing = max(target.spacing_m, source.spacing_m)
    rough = EvidenceLimits(base + 0.2, np.radians(25.0), 2.5 * spacing, margin_m=0.4, margin_relative=0.03)
    middle = EvidenceLimits(base + 0.12, np.radians(22.0), 2.5 * spacing, margin_m=0.3, margin_relative=0.02)
    centre = source.points.mean(axis=0)
    kept = hypotheses
    for points, limits, most in ((FIRST_POINTS, rough, SECOND_MOST), (SECOND_POINTS, middle, 0)):
        scores = score_poses(kept.rotations, kept.translations_m, target, source, points=points, limits=limits)
        order = np.argsort(-scores.score, kind="stable")
        if most:
            kept = kept[order[:most]]
        else:
            kept = kept[_distinct(kept, order, centre, angle_rad=0.05, shift_m=0.35, most=POLISH_MOST)]
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
        points=LAST_POINTS,
        limits=strict_limits(noise_m, spacing),
    )
    order = np.argsort(-scores.score, kind="stable")
    chosen = _distinct(final, order, centre, angle_rad=np.radians(4.5), shift_m=0.3, most=POLISH_MOST)
    return RankedPoses(
        tuple(poses[k] for k in chosen),
        PoseScores(scores.support[chosen], scores.violation[chosen], scores.overlap[chosen], scores.score[chosen]),
        len(hypotheses),
    )


def strict_limits(noise_m: float, spacing_m: float) -> EvidenceLimits:
    """Give the limits of the final test of a pose that has been polished."""
    return EvidenceLimits(float(np.clip(3.0 * noise_m, 0.05, 0.25)) + 0.03, np.radians(20.0), 2.5 * spacing_m)


def _scores(forward: Evidence, backward: Evidence) -> PoseScores:
    support = 0.5 * (forward.support + backward.support)
    violation = 0.5 * (forward.violation + backward.violation)
    return PoseScores(
        support=support,
        violation=violation,
        overlap=np.maximum(forward.support, backward.support),
        score=support - VIOLATION_PENALTY * np.maximum(violation - VIOLATION_FLOOR, 0.0),
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
