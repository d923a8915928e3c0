"""Search with what is known beforehand: more hypotheses near it, and the decision where the scans allow several poses.

What the scans can decide they decide. Where they cannot (the answer is ambiguous), poses that contradict the levelling
or the approximate poses are left out. Where they clearly prefer a pose that contradicts these, that pose stays the
answer, never accepted without doubt.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Indices
from algorithms.matching.hypotheses import RankedPoses, rank_hypotheses
from algorithms.matching.priors import DECIDING_ALPHA, PairPriors
from algorithms.matching.votes import Motions
from algorithms.scans.pose_scores import PoseScores
from algorithms.scans.surface_index import SurfaceIndex

if TYPE_CHECKING:
    import algorithms.matching.coarse_registration

LEAST_SHARE_OF_BEST = 0.25
"""An agreeing pose that scores less than this share of a contradicting one is no alternative to it."""


def rank_with_priors(
    hypotheses: Motions, target: SurfaceIndex, source: SurfaceIndex, priors: PairPriors, *, noise_m: float
) -> RankedPoses:
    """Rank all hypotheses, and once more those near the approximate pose, which might be lost among so many others.

    Parameters
    ----------
    hypotheses
        Motions target from source (`PairPriors.proposed`).
    target, source
        The two scans.
    priors
        What is known.
    noise_m
        Standard deviation of single points [m].
    """
    ranked = rank_hypotheses(hypotheses, target, source, noise_m=noise_m)
    near = priors.near(hypotheses)
    if len(near) in {0, len(hypotheses)}:
        return ranked
    again = rank_hypotheses(near, target, source, noise_m=noise_m)
    return ranked.joined(replace(again, tested=0), source)


def decided_with_priors(
    found: "algorithms.matching.coarse_registration.CoarseRegistration",
    ranked: RankedPoses,
    priors: PairPriors,
    described: Callable[[RankedPoses], "algorithms.matching.coarse_registration.CoarseRegistration"],
) -> "algorithms.matching.coarse_registration.CoarseRegistration":
    """Decide by what is known beforehand where the scans cannot.

    Parameters
    ----------
    found
        What the scans say of all poses.
    ranked
        These poses.
    priors
        What is known.
    described
        Says of fewer poses what the scans say of them.
    """
    agree = priors.agree_with(ranked.poses)
    first = _place(found.target_from_source, ranked.poses)
    agreeing = np.flatnonzero(agree)
    if agree.all() or len(agreeing) == 0 or (agree[first] and not found.ambiguous):
        return found
    left = described(_selected(ranked, agreeing))
    best = _place(left.target_from_source, ranked.poses)
    if found.ambiguous and priors.agree_with((left.target_from_source,), DECIDING_ALPHA)[0]:
        # only poses between which the scans themselves cannot decide are left to other knowledge
        undecided = best == first or described(_selected(ranked, np.array(sorted({first, best})))).ambiguous
        if undecided:
            return replace(left, remarks=(*left.remarks, _left_out(priors)))
    if agree[first] or left.score <= LEAST_SHARE_OF_BEST * found.score:
        return found
    reason = (
        f"the pose that the scans prefer (score {found.score:.2f}) contradicts what was said of "
        f"{_names(priors)}; the best one that agrees with it scores {left.score:.2f}"
    )
    return replace(
        found,
        ambiguous=True,
        runner_up=left.target_from_source,
        runner_up_score=left.score,
        runner_up_support=left.support,
        reasons=(*found.reasons, reason),
    )


def _names(priors: PairPriors) -> str:
    """Name both stations in an order that does not depend on which is the target."""
    return " and ".join(sorted((priors.source.name, priors.target.name)))


def _left_out(priors: PairPriors) -> str:
    known = [
        what
        for what, fact in (("the levelling", priors.tilt_std_rad), (priors.in_words, priors.target_from_source))
        if fact is not None
    ]
    return (
        f"the scans alone leave several poses possible; those that contradict {' or '.join(known)} of "
        f"{_names(priors)} were left out"
    )


def _place(pose: RigidTransform, poses: Sequence[RigidTransform]) -> int:
    return next(k for k, other in enumerate(poses) if other is pose)


def _selected(ranked: RankedPoses, which: Indices) -> RankedPoses:
    """Keep some of the poses, in their order."""
    scores = ranked.scores
    return RankedPoses(
        tuple(ranked.poses[k] for k in which),
        PoseScores(scores.support[which], scores.violation[which], scores.overlap[which], scores.score[which]),
        ranked.tested,
    )
