"""Decide whether a pose is to be trusted: accepted, doubtful, rejected or ambiguous, with reasons in words and figures.

The limits come from data: every pair of the development sets (garage, yard, flat, street, hall, corridor; 86 pairs,
each scan moved by a random rigid motion), 60 pairs of scans of different places, and 91 pairs of simulated buildings
(office, house, pipe hall, two squares). A wrong pose called accepted is the worst outcome, so every limit leaves a gap
to the wrong poses seen: where nothing but chance makes them they reach a score of 0.22 and have 17 lines and planes in
common (0.29 in a set whose reference is weak). Poses that a symmetry makes possible score far higher; these limits do
not find them, `algorithms.matching.self_likeness` does. (Set before sparse surface was kept and all shifts were
searched; with both, right poses score higher.)
"""

from dataclasses import dataclass
from enum import StrEnum

from algorithms.quality.unexplained import UnexplainedPiece

LEAST_SCORE = 0.1
"""Below this score no pose is worth showing: wrong poses reach it by chance."""
STRONG_SCORE = 0.4
"""With nearly twice the score that a wrong pose reached, all that is asked of the runner-up is not to be as good."""
CLEAR_SCORE, CLEAR_RATIO = 0.25, 0.7
"""A score that no wrong pose reached, with a runner-up that is clearly worse."""
LONE_SCORE, LONE_RATIO = 0.2, 0.5
"""A lower score (small overlap, an uncertain instrument position) is enough when nothing else comes near."""
FEATURE_RATIO, FEATURE_SUPPORTERS, FEATURE_FACTOR = 0.3, 30, 4
"""Any credible score is enough when dozens of whole lines and planes lie on each other and hardly any in the other
pose: an uncertain instrument position lowers the score, never the number of common features. No pose of chance
had more than 17."""
CONTRADICTED_SHARE, CONTRADICTED_RATIO = 0.03, 0.3
"""Where more than this share of what can be judged stands in free space, no other pose may come near: in a building the
right pose shows a tenth of that, among trees and with an estimated instrument position more, but nothing else fits
there."""
SPOTLESS_SUPPORT, SPOTLESS_SHARE = 0.06, 0.03
"""The only pose that hardly anything speaks against is accepted from this support on, while no more than this share of
what can be judged does: in 164 pairs of one place no such pose was wrong, in 61 of different places one was, with a
support of 0.048."""
CONTROLLED_SUPPORT, CONTROLLED_CONDITIONS = 0.03, 20
"""Or from this support on where the lines and planes that agree there control each other with so many conditions more
than parameters: what fits by chance agrees to a decimetre, not to the noise. Of poses that hardly anything speaks
against and that lay less than `SPOTLESS_SUPPORT` on surface the wrong ones had up to 14 such conditions (870 pairs of
one place or two), right ones up to 43; in regular buildings wrong ones that fit better have more."""
LEAST_SUPPORTERS = 6
"""Lines and planes that both scans must see. Wrong poses lay few whole features on each other, however much fits."""
BLIND_SCORE, BLIND_RATIO = 0.5, 0.5
"""Without the instruments' positions free space says nothing, and symmetric rooms look alike: be stricter."""
AMBIGUOUS_RATIO = 0.8
"""Another pose with this share of the score is as good; where a caller allows it more, the pose is doubtful still."""
MAX_VIOLATION_SHARE = 0.08
WORTH_A_WORD_M2 = 1.0
"""Larger pieces of surface in free space are mentioned."""
MOVABLE_M2 = 10.0
"""Larger ones make the pose doubtful: twice the largest beside 320 right poses (a yard with people and trees, streets
with cars, rooms in which things were moved). Of two equal houses one was laid on the other with 10.8 m2 so."""
LEAST_OVERLAP = 0.15
CONTROL_M2 = 0.2
"""So much surface must stand across every direction of shift without any one plane (`control`), or the pose may be a
corner that was laid on another one..."""
UNCONTROLLED_SHARE = 0.005
"""...and then no more than this share of what can be judged may speak against it. Of 397 accepted pairs of set-ups at
random in an office five were wrong, with 0.02 m2 and less, and 0.010 to 0.054 against them; of the right ones 128 had
less than 0.2 m2, and eight of these more than 0.005 against them."""


class AcceptanceStatus(StrEnum):
    """What is to be thought of a pose."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"
    REJECTED = "rejected"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True)
class Verification:
    """What the surfaces of two scans say of a pose."""

    overlap_decimetre: float
    """Share of the thinned surface within 0.1 m of the other scan's, of the scan where it is larger, 0..1."""
    overlap_half_metre: float
    """The same within 0.5 m."""
    rms_m: float
    """Rms point-to-plane distance in the overlap (points within 0.1 m) [m]; 0 when nothing overlaps."""
    support_share: float
    """Mean of both scans' shares that fit in place and normal, each a geometric mean over directions, 0..1."""
    violation_share: float
    """Mean of both scans' shares that stand where the other instrument looked through, 0..1."""
    score: float
    """Support share, less the more of what can be judged stands in free space (`algorithms.scans.pose_scores`)."""
    free_space_known: bool
    """Whether both instruments' positions are known."""
    controlled_m2: float
    """Surface across the worst determined direction of shift that is left without any one plane [m2] (`control`)."""
    unexplained: tuple[UnexplainedPiece, ...] = ()
    """The largest pieces of surface that stand where the other instrument looked through, the largest first."""


@dataclass(frozen=True)
class Verdict:
    """The judgement of a pose."""

    status: AcceptanceStatus
    reasons: tuple[str, ...]
    """Why, in words with figures."""


def judge(
    verification: Verification,
    *,
    runner_up_score: float,
    supporters: int,
    runner_up_supporters: int | None = None,
    lone_spotless: bool = False,
    conditions: int = 0,
    ambiguity_ratio: float = AMBIGUOUS_RATIO,
) -> Verdict:
    """Judge a pose by how well the scans fit in it, and by how well they fit in the best clearly different one.

    Parameters
    ----------
    verification
        What the surfaces say of the pose.
    runner_up_score
        Score of the best clearly different pose; 0 if there is none.
    supporters, runner_up_supporters
        Lines and planes that both scans see in the pose, and in the other one (None: not counted; many features never
        make up for a low score then).
    lone_spotless
        Whether hardly anything speaks against the pose and clearly more against every other, all shifts searched.
    conditions
        Redundancy of the lines and planes that agree in the pose; 0 where too few of them do.
    ambiguity_ratio
        Share of the score from which another pose makes this one ambiguous.
    """
    score = verification.score
    ratio = max(runner_up_score, 0.0) / max(score, 1e-9)
    seen_through = (
        f"{verification.violation_share:.1%} stands where the other scan looked through"
        if verification.free_space_known
        else "what stands where the other scan looked through is not known"
    )
    fit = f"{verification.support_share:.0%} of the surface fits and {seen_through} (score {score:.2f})"
    judged = verification.support_share + verification.violation_share
    blind = not verification.free_space_known
    alone = lone_spotless and not blind and verification.violation_share <= SPOTLESS_SHARE * judged
    if score < LEAST_SCORE and not alone:
        return Verdict(AcceptanceStatus.REJECTED, (f"{fit}: below {LEAST_SCORE:.2f} no pose is credible",))
    if verification.violation_share > MAX_VIOLATION_SHARE:
        return Verdict(AcceptanceStatus.REJECTED, (f"{fit}: more than {MAX_VIOLATION_SHARE:.0%} in free space",))
    if ratio >= ambiguity_ratio and not alone:
        return Verdict(
            AcceptanceStatus.AMBIGUOUS, (f"{fit}, but a clearly different pose scores {runner_up_score:.2f}",)
        )
    if alone:
        fit += "; it is the only pose that so little speaks against"
        doubts = _doubts_alone(verification, conditions)
    else:
        doubts = _doubts(verification, ratio, supporters, runner_up_supporters)
    remarks, uncontrolled = _control(verification)
    doubts += uncontrolled
    largest = next(iter(verification.unexplained), None)
    too_large = largest is not None and largest.area_m2 > MOVABLE_M2
    status = AcceptanceStatus.DOUBTFUL if doubts or too_large else AcceptanceStatus.ACCEPTED
    best_other = f"{fit}; the best other pose scores {runner_up_score:.2f}"
    return Verdict(status, (best_other, *doubts, *remarks, *_in_words(largest)))


def _in_words(largest: UnexplainedPiece | None) -> list[str]:
    """Name the largest piece of surface in free space where it is large: what the reader should look at."""
    if largest is None or largest.area_m2 < WORTH_A_WORD_M2:
        return []
    seen, other = ("target", "source") if largest.in_target else ("source", "target")
    words = (
        f"about {largest.area_m2:.1f} m2 of surface in one piece, seen by the {seen}, stands where the {other} looked "
        f"through, {largest.range_m:.0f} m from its instrument: it moved, or this is another place that looks like it"
    )
    if largest.area_m2 > MOVABLE_M2:
        words += f"; from {MOVABLE_M2:.0f} m2 on that makes the pose doubtful"
    return [words]


def _control(verification: Verification) -> tuple[list[str], list[str]]:
    """Say it where the pose hangs on single planes, as where one corner lies on another: remarks, doubts."""
    if verification.controlled_m2 >= CONTROL_M2:
        return [], []
    hangs = (
        f"one direction of the shift hangs on a single plane (without it {verification.controlled_m2:.2f} m2 of "
        f"surface stand across it; {CONTROL_M2:.1f} m2 would control it), as where one corner is laid on another"
    )
    if not verification.free_space_known:
        return [], [f"{hangs}, and free space, which could tell, is not known"]
    share = verification.violation_share / max(verification.support_share + verification.violation_share, 1e-9)
    if share <= UNCONTROLLED_SHARE:
        return [f"{hangs}, but hardly anything speaks against it"], []
    return [], [f"{hangs}, and {share:.1%} of what can be judged speaks against it ({UNCONTROLLED_SHARE:.1%} allowed)"]


def _doubts_alone(verification: Verification, conditions: int) -> list[str]:
    """Say what keeps the only spotless pose from being accepted; features in common are not asked for."""
    support = verification.support_share
    if support >= SPOTLESS_SUPPORT or (support >= CONTROLLED_SUPPORT and conditions >= CONTROLLED_CONDITIONS):
        return []
    doubt = (
        f"only {support:.1%} of the surface fits: so little may fit by chance with nothing against it "
        f"({SPOTLESS_SUPPORT:.0%} would be needed, or {CONTROLLED_SUPPORT:.0%} and {CONTROLLED_CONDITIONS} conditions "
        f"of lines and planes more than parameters, of which there are {conditions})"
    )
    return [doubt]


def _doubts(verification: Verification, ratio: float, supporters: int, runner_up_supporters: int | None) -> list[str]:
    """Say what keeps a pose from being accepted; nothing when it is clear."""
    score = verification.score
    doubts = []
    if ratio >= AMBIGUOUS_RATIO:
        doubts.append(f"a clearly different pose scores {ratio:.0%} of it; below {AMBIGUOUS_RATIO:.0%} would be needed")
    if not verification.free_space_known:
        if score < BLIND_SCORE or ratio > BLIND_RATIO:
            doubts.append(
                "the position of an instrument is unknown, so free space could not be tested: a score of "
                f"{BLIND_SCORE:.2f} and a runner-up below {BLIND_RATIO:.0%} of it would be needed"
            )
    elif not (
        score >= STRONG_SCORE
        or (score >= CLEAR_SCORE and ratio <= CLEAR_RATIO)
        or (score >= LONE_SCORE and ratio <= LONE_RATIO)
        or (
            ratio <= FEATURE_RATIO
            and runner_up_supporters is not None
            and supporters >= max(FEATURE_SUPPORTERS, FEATURE_FACTOR * runner_up_supporters)
        )
    ):
        doubts.append(
            f"the score is not clear: {STRONG_SCORE:.2f}, {CLEAR_SCORE:.2f} with a runner-up below {CLEAR_RATIO:.0%} "
            f"of it, or {LONE_SCORE:.2f} with one below {LONE_RATIO:.0%}, would be needed, or "
            f"{FEATURE_SUPPORTERS} lines and planes that agree"
        )
    judged = verification.support_share + verification.violation_share
    if verification.violation_share > CONTRADICTED_SHARE * judged and ratio > CONTRADICTED_RATIO:
        doubts.append(
            f"{verification.violation_share / judged:.0%} of what can be judged speaks against the pose, and another "
            f"one scores {ratio:.0%} as much; {CONTRADICTED_SHARE:.0%} or {CONTRADICTED_RATIO:.0%} would be allowed"
        )
    if supporters < LEAST_SUPPORTERS:
        doubts.append(f"only {supporters} lines and planes are seen by both scans, {LEAST_SUPPORTERS} would be needed")
    if verification.overlap_decimetre < LEAST_OVERLAP:
        doubts.append(f"only {verification.overlap_decimetre:.0%} of the surface overlaps within 0.1 m")
    return doubts
