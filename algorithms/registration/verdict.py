"""The verdict of every method: surfaces, runner-up, geometry, tests and rigidity together, of one pose."""

from dataclasses import dataclass, replace

from algorithms.evidence.calibration import Calibration
from algorithms.evidence.place import Place, place_of
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.options import MatchingOptions
from algorithms.matching.self_likeness import are_near
from algorithms.quality.acceptance import (
    MAX_VIOLATION_SHARE,
    MOVABLE_M2,
    AcceptanceStatus,
    Verdict,
    Verification,
    judge,
)
from algorithms.quality.overlap import verify_pose
from algorithms.registration.base import (
    FinalPose,
    FineRegistration,
    PairResult,
    PairStatus,
    RegistrationProblem,
    TargetFit,
)
from algorithms.registration.final_pose import widened
from algorithms.registration.final_verdict import doubts_of_slivers, status_of_final
from algorithms.registration.pair_verdict import agreement_doubts, expected_supporters, rigidity_of
from algorithms.registration.precision import precision_of
from algorithms.scans.point_blocks import side_by_side

LEAST_PROBABILITY = 0.5
"""A place that is rather not the right one than the right one is not accepted, whatever the limits say."""
CERTAIN_PROBABILITY = 0.9
"""Probability of the place from which a pose may be coarse. Of two buildings taken for one no pose reaches it."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A pose to be judged."""

    final: FinalPose
    fine: FineRegistration | None
    """The lines and planes in it; None: it rests on surfaces alone."""
    hidden_m: float
    """How far an error that no test finds may shift it [m]."""
    doubts: tuple[str, ...] = ()
    """What is known against its place already."""
    findings: tuple[str, ...] = ()
    """What contradicts its precision; its covariance holds it."""
    targets: TargetFit | None = None
    """Survey targets that take part in it; None: none do."""


def judged(
    problem: RegistrationProblem, coarse: CoarseRegistration, answer: Answer, matching: MatchingOptions
) -> PairResult:
    """Verify a pose with the surfaces, and judge it.

    Parameters
    ----------
    problem
        Features of both scans.
    coarse
        The search; what else could be.
    answer
        The pose.
    matching
        Options of the search: from when on another pose is as good.
    """
    final, fine = answer.final, answer.fine
    verification, place = side_by_side(
        lambda: verify_pose(problem.target, problem.source, final.reduced.target_from_source),
        lambda: _place(problem, coarse, final),
    )
    supporters = coarse.support if fine is None else max(expected_supporters(fine), coarse.support)
    verdict = judge(
        verification,
        runner_up_score=coarse.runner_up_score,
        supporters=supporters,
        runner_up_supporters=coarse.runner_up_support,
        lone_spotless=coarse.lone_spotless,
        conditions=0 if fine is None or agreement_doubts(fine) else fine.adjustment.redundancy,
        ambiguity_ratio=matching.ambiguity_ratio,
    )
    if answer.targets is not None:
        verdict = _with_targets(verdict, verification, answer.targets)
    tested = rigidity_of(problem, final.reduced, verdict)
    findings = answer.findings
    if tested is not None:
        final, findings = widened(problem, final, tested), (*findings, *tested.doubts())
    precision = None
    if final.reduced.null_space.shape[1] == 0:
        precision = precision_of(problem, final, hidden_m=answer.hidden_m, targets=answer.targets, found=findings)
    doubts = *answer.doubts, *doubts_of_slivers(final, verification)
    if precision is None:
        doubts = *doubts, *findings
    status, reasons = status_of_final(
        problem, coarse, final, verdict, fine=fine, doubts=doubts, precision=precision, targets=answer.targets
    )
    controlled = answer.targets is not None and answer.targets.is_controlled
    if status.in_place and not controlled:
        status, reasons = _if_probable(status, reasons, place)
    elif status is PairStatus.DEGENERATE and place is not None:
        where = f"What is determined is in place with a probability of {place.probability:.0%}."
        reasons = (f"{reasons[0]} {where}", *reasons[1:])
    shown = None if fine is None else replace(fine, pose=final.pose)
    return PairResult(
        status,
        reasons,
        coarse,
        shown,
        verification,
        final=final,
        rigidity=tested,
        targets=answer.targets,
        place=place,
        precision=precision,
    )


def _place(problem: RegistrationProblem, coarse: CoarseRegistration, final: FinalPose) -> Place | None:
    """Say how probable the pose is beside the others that the search found."""
    calibration = Calibration.read()
    if calibration is None:
        return None
    pose = final.reduced.target_from_source
    surfaces = problem.target.index, problem.source.index
    others = [each for each in coarse.others if not are_near(pose, each, *surfaces)]
    return place_of(problem.target, problem.source, [pose, *others], calibration)


def _if_probable(
    status: PairStatus, reasons: tuple[str, ...], place: Place | None
) -> tuple[PairStatus, tuple[str, ...]]:
    """Keep a pose in place unless its place is improbable: then another one, or none of those found, is right.

    Where the precision is contradicted, less controls the place: it must be more probable then.
    """
    least = CERTAIN_PROBABILITY if status is PairStatus.COARSE else LEAST_PROBABILITY
    if place is None or place.probability >= least:
        return status, reasons
    likely = sum(each.probability for each in place.others)
    doubt = (
        f"that this is the right place is probable to {place.probability:.0%}, that it is another one that was found "
        f"to {likely:.0%}, and that it is none of them to {place.none:.0%} ({least:.0%} would be needed)"
    )
    ambiguous = place.probability < LEAST_PROBABILITY and likely > place.none
    return PairStatus.AMBIGUOUS if ambiguous else PairStatus.DOUBTFUL, (*reasons, doubt)


def _with_targets(verdict: Verdict, verification: Verification, targets: TargetFit) -> Verdict:
    """Let targets that control each other stand where the scans hardly overlap; what stands in free space still speaks.

    Surfaces that say too little are no argument against points that were identified; such as contradict are.
    """
    largest = max((piece.area_m2 for piece in verification.unexplained), default=0.0)
    if verdict.status is AcceptanceStatus.ACCEPTED or not targets.is_controlled:
        return verdict
    if verification.violation_share > MAX_VIOLATION_SHARE:
        return verdict
    words = f"{int(targets.used.sum())} common targets that control each other tell the place; of the surfaces: "
    reasons = (words + verdict.reasons[0], *verdict.reasons[1:])
    if largest > MOVABLE_M2:
        return Verdict(AcceptanceStatus.DOUBTFUL, reasons)
    return Verdict(AcceptanceStatus.ACCEPTED, reasons)
