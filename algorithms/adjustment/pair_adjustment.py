"""Adjusting one pose, with what its geometry leaves free held at the start values (MATH 5)."""

import numpy as np

from algorithms.adjustment.pair_problem import PairProblem
from algorithms.adjustment.problem import LinearSystem
from algorithms.adjustment.rank import RankReport, UserOrigins, analyse_rank
from algorithms.adjustment.solver import Solution, solve
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.weights import whitening_of

PURE_TURN = 1e-9
"""A condition whose coefficients of the shift are below this share holds a turn."""


def adjust_pair(
    problem: PairProblem,
    start: Unknowns,
    system: LinearSystem,
    rough: bool,
    *,
    origins: UserOrigins,
    max_iterations: int,
) -> Solution:
    """Adjust; what is free is decided at the start pose and, unless roughly, checked at the solution (MATH 5.2).

    Parameters
    ----------
    problem
        Correspondences between reduced frames.
    start
        Start pose between the reduced frames, as station 1.
    system
        The problem at the start pose.
    rough
        Whether the figures need not be final (`solve`).
    origins
        Where the origins of the reduced frames lie in the user's frames.
    max_iterations
        Limit of rounds.
    """
    weights = whitening_of(system)
    whitened = weights.apply(system.dense_jacobian)
    report = analyse_rank(problem, system, whitened.T @ whitened, start.poses[1], origins)
    solution = solve(problem, start, report.held, max_iterations, linearised=(system, weights), rough=rough)
    if rough:
        return solution
    checked = analyse_rank(problem, solution.system, solution.normal_matrix, solution.pose, origins)
    if checked.rank == report.rank:
        return solution
    return solve(problem, solution.unknowns, checked.held, max_iterations)


def rank_of(problem: PairProblem, solution: Solution, origins: UserOrigins) -> RankReport:
    """Say what the geometry determines at a solution (MATH 5.1 to 5.3).

    What was held is never called determined, also where the decision is a close one and falls otherwise here: the
    covariance knows nothing of it.

    Parameters
    ----------
    problem
        The correspondences that were adjusted.
    solution
        Their solution.
    origins
        Where the origins of the reduced frames lie in the user's frames.
    """
    held = solution.held
    turns = int(np.count_nonzero(np.linalg.norm(held[3:], axis=0) < PURE_TURN * np.linalg.norm(held, axis=0)))
    return analyse_rank(
        problem, solution.system, solution.normal_matrix, solution.pose, origins,
        least_free=(held.shape[1] - turns, turns),
    )  # fmt: skip
