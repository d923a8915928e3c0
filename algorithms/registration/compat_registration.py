"""The work of the method `lines-compat`: the dissertation's coarse and fine registration, and its own figures."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.plucker_adjustment import adjust_plucker
from algorithms.arrays import IndexPairs, OtherIndexPairs
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.correspondences import GATES
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.compat_matching import match_by_pairs
from algorithms.registration.lines_compat import LinesCompatMethod, PairVotingOptions
from algorithms.registration.own_estimates import register_own_way
from algorithms.registration.own_procedures import OwnProcedure, Proposal, estimated, pose_difference

LABEL = "Lichtenstein 2011 as printed: 6 Plücker components per line, unit weights, sigma0 with 6n-6"


def register_as_dissertation(problem: RegistrationProblem, method: LinesCompatMethod, progress: Progress) -> PairResult:
    """Register two scans as the dissertation does; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans, of which the lines are used.
    method
        Options.
    progress
        Is told the steps.
    """

    def propose(problem: RegistrationProblem, _search: CoarseRegistration) -> Proposal:
        return _voted(problem, method.voting)

    procedure = OwnProcedure(LABEL, method.matching, method.adjustment, propose, adjust_plucker, keeps_all=True)
    return register_own_way(problem, procedure, progress)


def _voted(problem: RegistrationProblem, voting: PairVotingOptions) -> Proposal:
    """Vote, then adjust in several steps, each without the lines that are too far apart in the one before."""
    match = match_by_pairs(problem.target.lines, problem.source.lines, voting)
    lines, pose = match.lines, match.target_from_source
    for max_angle_rad, max_distance_m in GATES:
        lines = _near(problem, lines, pose, max_angle_rad, max_distance_m)
        pose = estimated(problem, adjust_plucker, lines, pose).pose.target_from_source
    turn = float(np.linalg.norm(pose_difference(match.target_from_source, pose)[:3]))
    centre = problem.source.lines.anchors.mean(axis=0)
    shift = float(np.linalg.norm(match.target_from_source.apply(centre) - pose.apply(centre)))
    found = f"coarse registration: {match.votes} of {match.motions} motions agree, {len(match.lines)} lines correspond"
    off = f"the coarse pose differs from the fine one by {turn:.4f} rad and {shift:.3f} m in the middle of the lines"
    return Proposal(lines, pose, (found, off))


def _near(
    problem: RegistrationProblem, lines: IndexPairs, pose: RigidTransform, max_angle_rad: float, max_distance_m: float
) -> OtherIndexPairs:
    """Keep the pairs of lines whose tilt and offset in a pose are within the limits."""
    residuals = LineLine(problem.target.lines, problem.source.lines, lines).linearised(pose).residuals
    tilts, offsets = (np.linalg.norm(residuals[:, part], axis=1) for part in (slice(0, 2), slice(2, 4)))
    return np.asarray(lines[(np.arctan(tilts) <= max_angle_rad) & (offsets <= max_distance_m)])
