"""How well two scans fit in a pose: surface on surface, and nothing in space that was seen through."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Scalars
from algorithms.scans.surface_index import Evidence, EvidenceLimits, SurfaceIndex, evidence_of

FINAL_POINTS = 8000
"""Surface points of each scan in a final test."""
CONTRADICTION_FLOOR = 0.03
"""Share of what can be judged (what fits or stands in free space) that may stand in free space in the true pose: moved
objects, mixed pixels, margins. Right poses of the development sets show a hundredth or less where the instrument's
position is known, up to a tenth where it was estimated among trees; wrong ones that fit well 4 to 20 %."""
CONTRADICTION_PENALTY = 18.0
"""Each further percent costs so many percent of the support."""
VIOLATION_FLOOR, VIOLATION_PENALTY = 0.01, 8.0
"""The balance of a pose: a share of the whole surface up to the first value may stand in free space, and what goes
beyond costs this multiple of support."""


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
    """(h,) support times exp(-penalty · the share of what can be judged that stands in free space, above the floor)."""

    @property
    def charitable(self) -> Scalars:
        """(h,) what a pose is worth as a rival of a better one: contradictions count less than in its own favour.

        Where little of the surface can be judged at all, a few points in free space refute nothing.
        """
        return np.asarray(np.maximum(self.score, balance(self.support, self.violation)))


def balance(support: Scalars | float, violation: Scalars | float) -> Array:
    """Weigh what fits against what stands in free space; negative where two scans contradict each other.

    Parameters
    ----------
    support, violation
        Shares as of `PoseScores`.
    """
    return np.asarray(support - VIOLATION_PENALTY * np.maximum(np.asarray(violation) - VIOLATION_FLOOR, 0.0))


def score_poses(
    rotations: Array,
    translations_m: Array,
    target: SurfaceIndex,
    source: SurfaceIndex,
    *,
    points: int,
    limits: EvidenceLimits,
    sifting: bool = False,
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
    sifting
        Give up poses of which most of what has been judged so far stands in free space: their scores are rough and
        near zero, which is a fraction of the work where nearly all poses are wrong.
    """
    forward = evidence_of(rotations, translations_m, source, target, points=points, limits=limits, sifting=sifting)
    hopeful = np.arange(len(rotations))
    if sifting:
        hopeful = np.flatnonzero(forward.violation <= forward.fitting)
    back_rotations = np.ascontiguousarray(np.swapaxes(rotations[hopeful], 1, 2))
    back_translations = -np.einsum("hij,hj->hi", back_rotations, translations_m[hopeful])
    backward = evidence_of(
        back_rotations, back_translations, target, source, points=points, limits=limits, sifting=sifting
    )
    if len(hopeful) < len(rotations):
        # what one scan refutes needs no second opinion
        both = [part.copy() for part in (forward.fitting, forward.support, forward.violation)]
        for part, other in zip(both, (backward.fitting, backward.support, backward.violation), strict=True):
            part[hopeful] = other
        backward = Evidence(*both)
    return _scores(forward, backward)


def strict_limits(noise_m: float, spacing_m: float) -> EvidenceLimits:
    """Give the limits of the final test of a pose that has been polished."""
    return EvidenceLimits(float(np.clip(3.0 * noise_m, 0.05, 0.25)) + 0.03, np.radians(20.0), 2.5 * spacing_m)


def _scores(forward: Evidence, backward: Evidence) -> PoseScores:
    support = 0.5 * (forward.support + backward.support)
    violation = 0.5 * (forward.violation + backward.violation)
    contradicted = violation / np.maximum(support + violation, 1e-9)
    return PoseScores(
        support=support,
        violation=violation,
        overlap=np.maximum(forward.fitting, backward.fitting),
        score=support * np.exp(-CONTRADICTION_PENALTY * np.maximum(contradicted - CONTRADICTION_FLOOR, 0.0)),
    )
