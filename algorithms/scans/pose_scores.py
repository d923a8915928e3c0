"""How well two scans fit in a pose: surface on surface, and nothing in space that was seen through."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Scalars
from algorithms.scans.surface_index import Evidence, EvidenceLimits, SurfaceIndex, evidence_of

FINAL_POINTS = 8000
"""Surface points of each scan in a final test."""
VIOLATION_FLOOR = 0.01
"""Share of the moved surface in free space that the true pose may show: moved objects, mixed pixels, margins."""
VIOLATION_PENALTY = 8.0
"""How much support a share of violation above the floor costs."""


@dataclass(frozen=True, eq=False)
class PoseScores:
    """What speaks for and against h poses, both scans laid into each other."""

    support: Scalars
    """(h,) mean of both scans' shares that fit, each the geometric mean over the directions of normals, 0..1."""
    violation: Scalars
    """(h,) mean of both scans' shares in the other's free space, 0..1."""
    overlap: Scalars
    """(h,) larger of both scans' shares that fit: the smaller scan decides."""
    score: Scalars
    """(h,) support minus the penalty for violation above the floor."""


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


def strict_limits(noise_m: float, spacing_m: float) -> EvidenceLimits:
    """Give the limits of the final test of a pose that has been polished."""
    return EvidenceLimits(float(np.clip(3.0 * noise_m, 0.05, 0.25)) + 0.03, np.radians(20.0), 2.5 * spacing_m)


def _scores(forward: Evidence, backward: Evidence) -> PoseScores:
    support = 0.5 * (forward.support + backward.support)
    violation = 0.5 * (forward.violation + backward.violation)
    return PoseScores(
        support=support,
        violation=violation,
        overlap=np.maximum(forward.fitting, backward.fitting),
        score=support - VIOLATION_PENALTY * np.maximum(violation - VIOLATION_FLOOR, 0.0),
    )
