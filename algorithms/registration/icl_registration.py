"""The work of the method `icl`, iterative closest line: correspondences and pose in turns until nothing changes."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.alshawa import adjust_alshawa
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.correspondences import corresponding_lines
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.icl import IclMethod, IclStart
from algorithms.registration.own_estimates import register_own_way
from algorithms.registration.own_procedures import OwnProcedure, Proposal, estimated

LABEL = "Iterative closest line (Alshawa 2007): closest lines, then eqs. 2.1-2.4 of Lichtenstein 2011, in turns"
NARROWING = 0.5
"""Factor of the limits each time the correspondences settle, until they reach the final ones."""
FINAL_ANGLE_RAD, FINAL_DISTANCE_M = 0.02, 0.05
"""Limits in which the correspondences must settle at last, those of the method `lines`."""


def register_by_closest_lines(problem: RegistrationProblem, method: IclMethod, progress: Progress) -> PairResult:
    """Register two scans by iterative closest lines; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans, of which the lines are used.
    method
        Options.
    progress
        Is told the steps.
    """

    def propose(problem: RegistrationProblem, search: CoarseRegistration) -> Proposal:
        return closest_lines(problem, start_of(problem, method.start, search.target_from_source), method)

    procedure = OwnProcedure(LABEL, method.matching, method.adjustment, propose, adjust_alshawa)
    return register_own_way(problem, procedure, progress)


def start_of(problem: RegistrationProblem, start: IclStart, found: RigidTransform) -> RigidTransform:
    """Give the pose between the reduced frames to start from.

    Parameters
    ----------
    problem
        Both scans.
    start
        Which start is wanted.
    found
        The search's answer.
    """
    if start is IclStart.MATCHING:
        return found
    identity = PoseEstimate(RigidTransform.identity(), np.zeros((6, 6)))
    return identity.moved_to_origins(-problem.target.origin_m, -problem.source.origin_m).target_from_source


def closest_lines(problem: RegistrationProblem, start: RigidTransform, method: IclMethod) -> Proposal:
    """Take each source line for its closest target line (each the other's), estimate, and so on.

    The limits narrow whenever the correspondences stay the same, down to the final ones.

    Parameters
    ----------
    problem
        Features of both scans.
    start
        Pose between the reduced frames.
    method
        Limits.

    Raises
    ------
    TooFewCorrespondencesError
        When fewer than two lines are close.
    """
    pose, last = start, np.empty((0, 2), dtype=np.int64)
    angle, distance = method.max_angle_rad, method.max_distance_m
    for iteration in range(1, method.max_iterations + 1):
        lines = corresponding_lines(problem.target, problem.source, pose, max_angle_rad=angle, max_distance_m=distance)
        if np.array_equal(lines, last):
            if angle <= FINAL_ANGLE_RAD and distance <= FINAL_DISTANCE_M:
                return Proposal(lines, pose, (f"correspondences settled after {iteration} rounds",))
            angle = max(NARROWING * angle, min(angle, FINAL_ANGLE_RAD))
            distance = max(NARROWING * distance, min(distance, FINAL_DISTANCE_M))
            continue
        pose, last = estimated(problem, adjust_alshawa, lines, pose).pose.target_from_source, lines
    return Proposal(last, pose, settled=False)
