"""Decide an adjustment of a pair from the source's side, and tell it from the target's.

Which correspondences are wrong is decided near limits, and what is left out when equations are linearised depends on
whose features the residuals are measured at. So one direction decides, whichever scan is called the target; the other
one only tells the same solution in its own frame and at its own features.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.external_reliability import component_effects
from algorithms.adjustment.inverse import DenseInverse, Information
from algorithms.adjustment.mount_errors import with_less_trust
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.pair_adjustment import adjust_pair
from algorithms.adjustment.pair_problem import PairProblem
from algorithms.adjustment.rank import UserOrigins
from algorithms.adjustment.snooping import SnoopingResult, SnoopingRules, adjust_and_snoop
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.testing import component_tests
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.weights import whitening_of
from algorithms.arrays import Flags, Matrix
from algorithms.geometry.poses import inversion_jacobian
from algorithms.geometry.rotations import rotation_matrix


def snooped_from_source(
    problem: PairProblem,
    observations: tuple[LineLine | PlanePlane, ...],
    start: RigidTransform,
    rules: SnoopingRules,
    origins: UserOrigins,
    *,
    power: float,
    max_iterations: int,
    suspicious: Flags | None,
) -> tuple[SnoopingResult, Matrix]:
    """Adjust and snoop (`adjust_and_snoop`) with target and source exchanged, and turn the result round (MATH 4.5).

    Parameters
    ----------
    problem
        All correspondences between the reduced frames.
    observations
        The same, by their kinds, in its order.
    start
        Target from source.
    rules
        Significance level and limits.
    origins
        Where the origins of the reduced frames lie in the user's frames.
    power
        Of the tests, for what they do not find.
    max_iterations
        Limit of rounds.
    suspicious
        True for correspondences that are out at first.

    Returns
    -------
    result
        In the target's frame.
    undetected
        (m, 6) what an error that just stays undetected in any component of the used correspondences does to the pose,
        told where it was decided: rotation vector in the target's axes [rad], shift at the centroid of the source's
        features [m].
    """
    turned = PairProblem(
        tuple(_exchanged(part) for part in observations),
        {1 - station: each for station, each in problem.plane_covariances.items()},
        {1 - station: each for station, each in problem.photo_covariances.items()},
    )
    adjust = partial(
        adjust_pair, origins=UserOrigins(origins.source_m, origins.target_m), max_iterations=max_iterations
    )
    found = adjust_and_snoop(turned, Unknowns.of_pair(start.inv()), rules, adjust, suspicious)
    mounts = tuple(replace(mount, photo=(1 - mount.photo[0], mount.photo[1])) for mount in found.mounts)
    steps = tuple(
        replace(step, plane=None if step.plane is None else (1 - step.plane[0], step.plane[1])) for step in found.steps
    )
    used = with_less_trust(problem, mounts).selected(found.used)
    components = component_tests(found.solution, rules.alpha, power)
    centroid = turned.selected(found.used).target_points().mean(axis=0)
    undetected = component_effects(found.solution, components, centroid, found.variance_factor).motions
    # the sign of an error means nothing
    back = rotation_matrix(found.solution.pose)
    undetected = np.hstack([undetected[:, :3] @ back, undetected[:, 3:] @ back])
    return replace(found, solution=_told(found.solution, used), mounts=mounts, steps=steps), undetected


def _exchanged(part: LineLine | PlanePlane) -> LineLine | PlanePlane:
    pairs = np.ascontiguousarray(part.pairs[:, ::-1])
    if isinstance(part, LineLine):
        return LineLine(part.source, part.target, pairs)
    return PlanePlane(part.source, part.target, pairs)


def _told(solution: Solution, used: PairProblem) -> Solution:
    """Tell a solution in the other frame: same motion and sum of squares, residuals at the other features."""
    unknowns = Unknowns.of_pair(solution.pose.inv())
    system = used.linearised(unknowns)
    whitening = whitening_of(system)
    whitened = whitening.apply(system.dense_jacobian)
    turn = inversion_jacobian(solution.pose)
    return replace(
        solution,
        unknowns=unknowns,
        # conditions bᵀ dx = 0 on changes of the pose, as conditions on those of its inverse
        held=np.linalg.solve(turn.T, solution.held),
        inverse=DenseInverse(turn @ solution.cofactors @ turn.T),
        information=Information(whitened.T @ whitened),
        system=system,
        whitening=whitening,
        linear_step=None,
    )
