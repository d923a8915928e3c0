"""Registration by a method that proposes a pose: estimated from there on and judged as strictly as any other.

The search over surfaces and free space is always made too. Where it finds a clearly different pose, that one stands as
the rival of the proposed one; so no method is judged more mildly than `auto`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.geometry.angles import GON_PER_RAD
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.options import MatchingOptions
from algorithms.matching.polish import polished
from algorithms.probabilities import chi2_isf
from algorithms.progress import Progress
from algorithms.registration.auto_registration import estimated_and_judged
from algorithms.registration.base import ConvergenceStep, OwnFigures, PairResult, PairStatus, RegistrationProblem
from algorithms.registration.pair_verdict import POLISH_M, POLISH_POINTS, beside, searched
from algorithms.registration.surface_options import SurfaceOptions
from algorithms.scans.pose_scores import score_poses, strict_limits

TEST_POINTS, WIDE_M = 3000, 0.15
"""Points of each scan by which surfaces choose between answers, and how far apart they count [m]."""
SIGNIFICANT = 0.001
"""Probability with which a pose is said to contradict the rigorous one by chance."""


@dataclass(frozen=True, eq=False)
class PoseProposal:
    """The pose that a method finds in its own way, and its figures."""

    pose: PoseEstimate
    """Target from source between the reduced frames, with the covariance that the method claims."""
    steps: tuple[EstimatorStep, ...]
    """What it counts of itself."""
    remarks: tuple[str, ...] = ()
    """How it was found, in words."""
    doubts: tuple[str, ...] = ()
    """What the method itself holds against its answer; it makes the pose doubtful."""
    convergence: tuple[ConvergenceStep, ...] = ()
    """Its iterations, if it comes to the pose step by step."""
    rate: float | None = None
    """By which factor its steps shrink at last."""
    order: float | None = None
    """Its order of convergence: 1 linear, 2 quadratic."""


@dataclass(frozen=True, eq=False)
class ProposingProcedure:
    """What one method does its own way, and the options of all that follows."""

    label: str
    """The method in words."""
    matching: MatchingOptions
    """The search that the result is verified against."""
    adjustment: AdjustmentOptions
    surfaces: SurfaceOptions
    propose: Callable[[RegistrationProblem, CoarseRegistration], PoseProposal]
    """Finds a pose; is given the search's answer, which it may use as a start."""


def register_by_proposal(problem: RegistrationProblem, procedure: ProposingProcedure, progress: Progress) -> PairResult:
    """Register two scans from the pose that a method proposes; every failure becomes a result with its reasons.

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
    progress.report(0.4, "proposal")
    try:
        proposal = procedure.propose(problem, search)
    except TooFewCorrespondencesError as error:
        reason = f"{procedure.label}: no pose is proposed: {error}"
        return PairResult(PairStatus.REJECTED, (reason,), search, None, None)
    except DegenerateGeometryError as error:
        return PairResult(
            PairStatus.DEGENERATE, (f"{procedure.label}: {error}",), search, None, None,
            free_directions=error.free_directions, advice=error.advice,
        )  # fmt: skip
    own = proposal.pose.target_from_source
    start = polished(own, problem.target.index, problem.source.index, distances_m=POLISH_M, points=POLISH_POINTS)
    result = estimated_and_judged(
        problem,
        beside(problem.source, search, start),
        procedure.matching,
        procedure.adjustment,
        procedure.surfaces,
        progress,
    )
    return _with_own_figures(problem, procedure, replace(result, coarse=search), proposal)


def best_on_surfaces(problem: RegistrationProblem, poses: Sequence[RigidTransform]) -> int:
    """Choose the answer in which most surface lies on surface and least in space that was seen through.

    Parameters
    ----------
    problem
        Features of both scans.
    poses
        Target from source between the reduced frames, at least one.
    """
    target, source = problem.target, problem.source
    limits = strict_limits(
        max(target.noise_std_m, source.noise_std_m), max(target.index.spacing_m, source.index.spacing_m)
    )
    scores = score_poses(
        np.array([pose.rotation.as_matrix() for pose in poses]),
        np.array([pose.translation for pose in poses], dtype=np.float64),
        target.index,
        source.index,
        points=TEST_POINTS,
        limits=replace(limits, max_distance_m=max(limits.max_distance_m, WIDE_M)),
    )
    return int(np.argmax(scores.score))


def _with_own_figures(
    problem: RegistrationProblem, procedure: ProposingProcedure, result: PairResult, proposal: PoseProposal
) -> PairResult:
    """Lay the proposed pose beside the final one."""
    remarks = list(proposal.remarks)
    if result.final is not None:
        remarks.append(_comparison(problem, proposal.pose, result.final.reduced))
    status = result.status
    if proposal.doubts and status.in_place:
        status = PairStatus.DOUBTFUL
    own = OwnFigures(
        label=procedure.label,
        pose=proposal.pose.moved_to_origins(problem.target.origin_m, problem.source.origin_m),
        steps=proposal.steps,
        lines=np.empty((0, 2), dtype=np.int64),
        declared_outliers=np.empty((0, 2), dtype=np.int64),
        max_angle_rad=None,
        max_distance_m=None,
        remarks=tuple(remarks),
        convergence=proposal.convergence,
        rate=proposal.rate,
        order=proposal.order,
    )
    return replace(
        result,
        status=status,
        reasons=(*result.reasons, *proposal.doubts),
        own_figures=own,
        rigorous=None if result.final is None else result.final.pose,
    )


def _comparison(problem: RegistrationProblem, own: PoseEstimate, final: PoseEstimate) -> str:
    """Say how far a proposed pose is from the final one, and whether what both claim explains it."""
    a, b = own.target_from_source, final.target_from_source
    turn = (b.rotation * a.rotation.inv()).as_rotvec()
    difference = np.concatenate([turn, np.asarray(b.translation) - np.asarray(a.translation)])
    covariance = own.covariance + final.covariance
    statistic = float(difference @ np.linalg.pinv(covariance, hermitian=True) @ difference)
    limit = float(chi2_isf(SIGNIFICANT, 6))
    centre = problem.source.surface.points.mean(axis=0)
    shift_mm = 1e3 * float(np.linalg.norm(b.apply(centre) - a.apply(centre)))
    return (
        f"the method's own pose is turned by {np.linalg.norm(turn) * GON_PER_RAD:.3f} gon from the one given, and "
        f"shifts the middle of the scan by {shift_mm:.0f} mm (test value "
        f"{statistic:.0f}, limit {limit:.0f}: {'more than' if statistic > limit else 'no more than'} both standard "
        "deviations explain)"
    )
