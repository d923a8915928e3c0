"""Registration with an estimator other than the rigorous one: both side by side, verified as strictly as any other."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_adjustment import LineAdjustment, adjust_lines
from algorithms.adjustment.line_estimate import LineEstimate, closeness
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.problem import SourcePlaneCovariances, TargetPlaneCovariances
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.arrays import Array, IndexPairs, OtherIndexPairs, Vector3
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.line_motion import lines_about
from algorithms.geometry.lines import Lines
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration, match_features
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress
from algorithms.quality.acceptance import Verification, judge
from algorithms.quality.overlap import verify_pose
from algorithms.registration.base import FineRegistration, OwnFigures, PairResult, PairStatus, RegistrationProblem
from algorithms.registration.line_registration import WORST_STD_M
from algorithms.registration.line_registration import _status as status_of_pair

OTHER_POSE_RAD, OTHER_POSE_M = np.radians(4.5), 0.3
"""Poses farther apart than this are clearly different ones, as for the runner-up of the search."""
CONTRADICTION_LEVEL = 0.001
"""Probability that own and rigorous pose of good lines are taken to contradict each other."""


@runtime_checkable
class Estimator(Protocol):
    """Estimates a pose from matched lines, such as `adjust_plucker`."""

    def __call__(
        self,
        target: Lines,
        source: Lines,
        pairs: IndexPairs,
        start: RigidTransform,
        *,
        target_plane_covariances: TargetPlaneCovariances | None,
        source_plane_covariances: SourcePlaneCovariances | None,
    ) -> LineEstimate:
        """Give the pose with its true and its claimed covariance."""
        ...


@dataclass(frozen=True, eq=False)
class Proposal:
    """Which lines belong together, and a pose near the answer."""

    lines: IndexPairs
    """(n, 2) target and source lines."""
    start: RigidTransform
    """Target from source between the reduced frames."""
    remarks: tuple[str, ...] = ()
    """How they were found, in words."""
    settled: bool = True
    """Whether the correspondences stayed the same at last."""


@dataclass(frozen=True, eq=False)
class OwnProcedure:
    """What one method does its own way."""

    label: str
    """Its estimator in words."""
    matching: MatchingOptions
    """The search that the result is verified against."""
    adjustment: AdjustmentOptions
    """The rigorous adjustment beside it."""
    propose: Callable[[RegistrationProblem, CoarseRegistration], Proposal]
    """Finds the correspondences; is given the search's answer, which it may use as a start."""
    estimate: Estimator
    keeps_all: bool = False
    """Use also the lines that the rigorous tests remove: for a method that has a test of its own."""


def register_own_way(problem: RegistrationProblem, procedure: OwnProcedure, progress: Progress) -> PairResult:
    """Register two scans by a method with an estimator of its own.

    The search over surfaces and free space is always made too: the best other pose decides with it whether the result
    is clear, so that no method accepts what `lines` would not. Statuses come from the rigorous adjustment of the same
    correspondences, from the surfaces in the method's own pose, and from the agreement of both poses.

    Parameters
    ----------
    problem
        Features of both scans.
    procedure
        The method.
    progress
        Is told the steps.
    """
    try:
        progress.report(0.0, "matching")
        search = match_features(problem.target, problem.source, procedure.matching)
    except DegenerateGeometryError as error:
        return replace(
            PairResult.without_pose(PairStatus.DEGENERATE, str(error)),
            free_directions=error.free_directions,
            advice=error.advice,
        )
    except TooFewCorrespondencesError as error:
        return PairResult.without_pose(PairStatus.REJECTED, f"no pose lays the scans on each other: {error}")
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
    verification = verify_pose(problem.target, problem.source, estimate.pose.target_from_source)
    return _result(problem, procedure, search, _Outcome(proposal, adjustment, used, estimate, verification))


def rigorously_adjusted(
    problem: RegistrationProblem, lines: IndexPairs, start: RigidTransform, options: AdjustmentOptions
) -> LineAdjustment:
    """Adjust the correspondences rigorously, lines only, correlated through the planes that they share."""
    return adjust_lines(
        problem.target.lines,
        problem.source.lines,
        lines,
        start,
        target_plane_covariances=problem.target.planes.covariances,
        source_plane_covariances=problem.source.planes.covariances,
        options=options,
    )


def kept_lines(lines: IndexPairs, adjustment: LineAdjustment) -> OtherIndexPairs:
    """Give the correspondences that the rigorous tests leave."""
    return np.asarray(lines[adjustment.lines.states != int(CorrespondenceState.REMOVED)])


def estimated(
    problem: RegistrationProblem, estimate: Estimator, lines: IndexPairs, start: RigidTransform
) -> LineEstimate:
    """Estimate the pose between the reduced frames, with the frames' origins moved to the instruments for it.

    Some estimators depend on where the origin lies: this is where the dissertation has it, and near the lines in every
    case. Without a known instrument the middle of the scan's lines is taken.

    Raises
    ------
    TooFewCorrespondencesError
        Below what the estimator needs.
    DegenerateGeometryError
        When its normal matrix is singular.
    """
    target, source = problem.target, problem.source
    origins = _origin(target), _origin(source)
    near = PoseEstimate(start, np.zeros((6, 6))).moved_to_origins(-origins[0], -origins[1])
    result = estimate(
        lines_about(target.lines, origins[0]),
        lines_about(source.lines, origins[1]),
        lines,
        near.target_from_source,
        target_plane_covariances=target.planes.covariances,
        source_plane_covariances=source.planes.covariances,
    )
    return replace(
        result, pose=result.pose.moved_to_origins(*origins), claimed=result.claimed.moved_to_origins(*origins)
    )


@dataclass(frozen=True, eq=False)
class _Outcome:
    """All that the parts of the result are made of, between the reduced frames."""

    proposal: Proposal
    adjustment: LineAdjustment
    used: IndexPairs
    estimate: LineEstimate
    verification: Verification


def _result(
    problem: RegistrationProblem, procedure: OwnProcedure, search: CoarseRegistration, outcome: _Outcome
) -> PairResult:
    """Judge the outcome and lay both poses side by side."""
    adjustment, estimate = outcome.adjustment, outcome.estimate
    pose = estimate.pose.with_covariance_scaled(adjustment.variance_factor)
    other = _clearly_different(problem.source, pose.target_from_source, search.target_from_source)
    verdict = judge(
        outcome.verification,
        runner_up_score=search.score if other else search.runner_up_score,
        supporters=len(outcome.proposal.lines),
    )
    fine = FineRegistration(
        outcome.proposal.lines,
        np.empty((0, 2), dtype=np.int64),
        adjustment,
        _in_files(problem, pose),
        adjustment.centroid_m + problem.target.origin_m,
    )
    status, reasons = status_of_pair(problem, search, fine, verdict)
    doubts = _doubts(problem, outcome, pose)
    if doubts and status is PairStatus.ACCEPTED:
        status = PairStatus.DOUBTFUL
    return PairResult(
        status,
        (*reasons, *doubts),
        search,
        fine,
        outcome.verification,
        rigorous=_in_files(problem, adjustment.pose_a_posteriori),
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
        rigorous=fine.pose,
    )


def _doubts(problem: RegistrationProblem, outcome: _Outcome, pose: PoseEstimate) -> list[str]:
    """Say what keeps the method's own pose from being accepted where the rigorous one would be."""
    doubts = []
    if not outcome.proposal.settled:
        doubts.append("the correspondences did not settle")
    if not outcome.estimate.converged:
        doubts.append("the method's own estimate did not settle")
    difference = pose_difference(pose.target_from_source, outcome.adjustment.pose.target_from_source)
    statistic = float(difference @ np.linalg.solve(pose.covariance, difference))
    if statistic > stats.chi2.isf(CONTRADICTION_LEVEL, 6):
        doubts.append(
            f"the method's own pose contradicts the rigorous adjustment of the same lines (test value {statistic:.0f}, "
            f"limit {stats.chi2.isf(CONTRADICTION_LEVEL, 6):.1f})"
        )
    points = problem.target.lines.anchors[outcome.used[:, 0]]
    worst = max(float(pose.error_ellipsoid(point).semi_axes_m[0]) for point in points)
    if worst > WORST_STD_M:
        doubts.append(f"lines lie up to {worst * 1e3:.0f} mm (standard deviation) from where they belong")
    return doubts


def pose_difference(first: RigidTransform, second: RigidTransform) -> Array:
    """Give (rotation vector on the left, translation) that lead from the first pose to the second, (6,)."""
    turn = (second.rotation * first.rotation.inv()).as_rotvec()
    return np.concatenate([turn, np.asarray(second.translation) - np.asarray(first.translation)])


def _clearly_different(source: ScanFeatures, first: RigidTransform, second: RigidTransform) -> bool:
    centre = source.surface.points.mean(axis=0)
    turned = (first.rotation * second.rotation.inv()).magnitude() > OTHER_POSE_RAD
    return bool(turned or np.linalg.norm(first.apply(centre) - second.apply(centre)) > OTHER_POSE_M)


def _origin(features: ScanFeatures) -> Vector3:
    if features.sensor_m is not None:
        return features.sensor_m
    return np.asarray(features.lines.anchors.mean(axis=0))


def _in_files(problem: RegistrationProblem, pose: PoseEstimate) -> PoseEstimate:
    return pose.moved_to_origins(problem.target.origin_m, problem.source.origin_m)
