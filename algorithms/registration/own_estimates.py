"""Registration with an estimator other than the rigorous one: both side by side, verified as strictly as any other."""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.line_estimate import LineEstimate, closeness
from algorithms.arrays import IndexPairs
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.probabilities import chi2_isf
from algorithms.progress import Progress
from algorithms.registration.base import FineRegistration, OwnFigures, PairResult, PairStatus, RegistrationProblem
from algorithms.registration.final_pose import of_features
from algorithms.registration.own_procedures import (
    OwnProcedure,
    Proposal,
    estimated,
    kept_lines,
    pose_difference,
    rigorously_adjusted,
)
from algorithms.registration.pair_verdict import (
    WORST_STD_M,
    beside,
    contradictions,
    largest_hidden_shift_m,
    searched,
)
from algorithms.registration.verdict import Answer, judged

CONTRADICTION_LEVEL = 0.001
"""Probability that own and rigorous pose of good lines are taken to contradict each other."""


def register_own_way(problem: RegistrationProblem, procedure: OwnProcedure, progress: Progress) -> PairResult:
    """Register two scans by a method with an estimator of its own.

    The search over surfaces and free space is always made too: the best other pose decides with it whether the result
    is clear, so that no method is judged more mildly than `lines`. Statuses come from the rigorous adjustment of the
    same correspondences, from the surfaces in the method's own pose, and from the agreement of both poses.

    Parameters
    ----------
    problem
        Features of both scans.
    procedure
        The method.
    progress
        Is told the steps.
    """
    progress.report(0.0, "matching")
    search = searched(problem, procedure.matching)
    if isinstance(search, PairResult):
        return search
    progress.report(0.6, "adjustment")
    try:
        proposal = procedure.propose(problem, search)
        adjustment = rigorously_adjusted(problem, proposal.lines, proposal.start, procedure.adjustment)
        if adjustment.rank < 6:
            return _undetermined(problem, search, proposal, adjustment)
        used = proposal.lines if procedure.keeps_all else kept_lines(proposal.lines, adjustment)
        estimate = estimated(problem, procedure.estimate, used, adjustment.pose.target_from_source)
    except TooFewCorrespondencesError as error:
        reason = f"{procedure.label}: no corresponding lines to estimate a pose from: {error}"
        return PairResult(PairStatus.REJECTED, (reason,), search, None, None)
    except DegenerateGeometryError as error:
        reason = f"{procedure.label}: {error}"
        return PairResult(PairStatus.DEGENERATE, (reason,), search, None, None, advice=error.advice)
    progress.report(0.9, "verification")
    return _result(problem, procedure, search, _Outcome(proposal, adjustment, used, estimate))


@dataclass(frozen=True, eq=False)
class _Outcome:
    """All that the parts of the result are made of, between the reduced frames."""

    proposal: Proposal
    adjustment: LineAdjustment
    used: IndexPairs
    estimate: LineEstimate


def _result(
    problem: RegistrationProblem, procedure: OwnProcedure, search: CoarseRegistration, outcome: _Outcome
) -> PairResult:
    """Judge the outcome and lay both poses side by side."""
    adjustment, estimate = outcome.adjustment, outcome.estimate
    pose = estimate.pose.with_covariance_scaled(adjustment.variance_factor)
    fine = FineRegistration(
        outcome.proposal.lines,
        np.empty((0, 2), dtype=np.int64),
        adjustment,
        _in_files(problem, pose),
        adjustment.centroid_m + problem.target.origin_m,
    )
    final = of_features(problem, fine, "lines", procedure.label, pose=pose)
    doubts = *contradictions(problem, search, fine), *_doubts(problem, outcome, pose)
    answer = Answer(final, fine, largest_hidden_shift_m(adjustment), doubts)
    result = judged(problem, beside(problem.source, search, pose.target_from_source), answer, procedure.matching)
    return replace(
        result,
        coarse=search,
        final=None,
        rigorous=of_features(problem, fine, "lines", "rigorously adjusted").pose,
        own_figures=_own_figures(problem, procedure, outcome),
    )


def _own_figures(problem: RegistrationProblem, procedure: OwnProcedure, outcome: _Outcome) -> OwnFigures:
    estimate = outcome.estimate
    near = closeness(problem.target.lines, problem.source.lines, outcome.used, estimate.pose.target_from_source)
    return OwnFigures(
        label=procedure.label,
        pose=_in_files(problem, estimate.claimed),
        steps=estimate.steps,
        lines=outcome.used,
        declared_outliers=outcome.used[estimate.declared],
        max_angle_rad=near.max_angle_rad,
        max_distance_m=near.max_distance_m,
        remarks=(*outcome.proposal.remarks, *estimate.remarks),
    )


def _undetermined(
    problem: RegistrationProblem, search: CoarseRegistration, proposal: Proposal, adjustment: LineAdjustment
) -> PairResult:
    """Refuse lines that leave a motion free: only the rigorous adjustment tells the estimable part from noise."""
    fine = FineRegistration(
        proposal.lines,
        np.empty((0, 2), dtype=np.int64),
        adjustment,
        _in_files(problem, adjustment.pose_a_posteriori),
        adjustment.centroid_m + problem.target.origin_m,
    )
    free = "; ".join(adjustment.free_directions)
    reason = (
        f"the lines determine only {adjustment.rank} of 6 parameters, free: {free}. {adjustment.advice}; the pose "
        "given is the rigorous one, with what is free left at its start"
    )
    return PairResult(
        PairStatus.DEGENERATE,
        (reason,),
        search,
        fine,
        None,
        free_directions=adjustment.free_directions,
        advice=adjustment.advice,
        rigorous=of_features(problem, fine, "lines", "rigorously adjusted").pose,
    )


def _doubts(problem: RegistrationProblem, outcome: _Outcome, pose: PoseEstimate) -> list[str]:
    """Say what keeps the method's own pose from being accepted where the rigorous one would be."""
    doubts = []
    if not outcome.proposal.settled:
        doubts.append("the correspondences did not settle")
    if not outcome.estimate.converged:
        doubts.append("the method's own estimate did not settle")
    difference = pose_difference(pose.target_from_source, outcome.adjustment.pose.target_from_source)
    statistic = float(difference @ np.linalg.pinv(pose.covariance, hermitian=True) @ difference)
    if statistic > chi2_isf(CONTRADICTION_LEVEL, 6):
        doubts.append(
            f"the method's own pose contradicts the rigorous adjustment of the same lines (test value {statistic:.0f}, "
            f"limit {chi2_isf(CONTRADICTION_LEVEL, 6):.1f})"
        )
    points = problem.target.lines.anchors[outcome.used[:, 0]]
    worst = max(float(pose.error_ellipsoid(point).semi_axes_m[0]) for point in points)
    if worst > WORST_STD_M:
        doubts.append(f"lines lie up to {worst * 1e3:.0f} mm (standard deviation) from where they belong")
    return doubts


def _in_files(problem: RegistrationProblem, pose: PoseEstimate) -> PoseEstimate:
    return pose.moved_to_origins(problem.target.origin_m, problem.source.origin_m)
