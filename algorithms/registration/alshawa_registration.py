"""The work of the method `lines-alshawa`: correspondences near the search's answer, then Alshawa's two steps."""

import numpy as np

from algorithms.adjustment.alshawa import adjust_alshawa
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.correspondences import GATES, corresponding_lines
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.lines_alshawa import LinesAlshawaMethod
from algorithms.registration.own_estimates import register_own_way
from algorithms.registration.own_procedures import OwnProcedure, Proposal, estimated, kept_lines, rigorously_adjusted

LABEL = "Alshawa 2007 (Lichtenstein 2011, eqs. 2.1-2.4): rotation, then translation, two conditions per line each"


def register_by_alshawa(problem: RegistrationProblem, method: LinesAlshawaMethod, progress: Progress) -> PairResult:
    """Register two scans by Alshawa's equations; every failure becomes a result with its status and reasons.

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
        return _near_search(problem, search, method)

    procedure = OwnProcedure(LABEL, method.matching, method.adjustment, propose, adjust_alshawa)
    return register_own_way(problem, procedure, progress)


def _near_search(problem: RegistrationProblem, search: CoarseRegistration, method: LinesAlshawaMethod) -> Proposal:
    """Find correspondences and pose in turns, from the search's answer on; wrong lines are left to the rigorous test.

    Alshawa takes the correspondences as given, so there is no test of his own that could find them.
    """
    pose, last = search.target_from_source, None
    for max_angle_rad, max_distance_m in GATES:
        limits = {"max_angle_rad": max_angle_rad, "max_distance_m": max_distance_m}
        lines = corresponding_lines(problem.target, problem.source, pose, **limits)
        if last is not None and np.array_equal(lines, last):
            break
        adjustment = rigorously_adjusted(problem, lines, pose, method.adjustment)
        if adjustment.rank < 6:
            return Proposal(lines, pose)
        pose = estimated(problem, adjust_alshawa, kept_lines(lines, adjustment), pose).pose.target_from_source
        last = lines
    return Proposal(lines, pose)
