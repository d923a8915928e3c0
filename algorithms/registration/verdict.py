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
from algorithms.scans.point_blocks import side_by_side

LEAST_PROBABILITY = 0.5
"""A place that is rather not the right one than the right one is not accepted, whatever the limits say."""


@dataclass(frozen=True, eq=False)
class Answer:
    """A pose to be judged."""

    final: FinalPose
    fine: FineRegistration | None
    """The lines and planes in it; None: it rests on surfaces alone."""
    hidden_m: float
    """How far an error that no test finds may shift it [m]."""
    doubts: tuple[str, ...] = ()
    """What is known against it already."""
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
    doubts = *answer.doubts, *doubts_of_slivers(final, verification), *(() if tested is None else tested.doubts())
    status, reasons = status_of_final(
        problem,
        coarse,
        final,
        verdict,
        fine=fine,
        doubts=doubts,
        hidden_m=answer.hidden_m,
        targets=answer.targets,
    )
    if tested is not None:
        final = widened(problem, final, tested)
    if status is PairStatus.ACCEPTED and (answer.targets is None or not answer.targets.is_controlled):
        status, reasons = _if_probable(place, reasons)
    shown = None if fine is None else replace(fine, pose=final.pose)
    return PairResult(
        status, reasons, coarse, shown, verification, final=final, rigidity=tested, targets=answer.targets, place=place
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


def _if_probable(place: Place | None, reasons: tuple[str, ...]) -> tuple[PairStatus, tuple[str, ...]]:
    """Accept a pose unless its place is improbable: then another one, or none of those found, is the right one."""
    if place is None or place.probability >= LEAST_PROBABILITY:
        return PairStatus.ACCEPTED, reasons
    likely = sum(each.probability for each in place.others)
    doubt = (
        f"that this is the right place is probable to {place.probability:.0%}, that it is another one that was found "
        f"to {likely:.0%}, and that it is none of them to {place.none:.0%} ({LEAST_PROBABILITY:.0%} would be needed)"
    )
    return PairStatus.AMBIGUOUS if likely > place.none else PairStatus.DOUBTFUL, (*reasons, doubt)


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
