"""The work of the method `ndt-3d`: distributions laid on distributions, estimated from there on."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.distributions.cell_registration import CellMatch, covariance_of, match_cells, starts_around
from algorithms.distributions.cells import cell_distributions
from algorithms.distributions.layer_registration import cell_sizes
from algorithms.errors import InvalidInputError, TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.icp_options import IcpOptions, IcpStart
from algorithms.registration.icp_registration import start_of
from algorithms.registration.ndt_3d import CellOptions, Ndt3dMethod
from algorithms.registration.proposals import (
    PoseProposal,
    ProposingProcedure,
    best_on_surfaces,
    register_by_proposal,
)

LABEL = "Normal distributions of both scans in cubic cells (Stoyanov, Magnusson, Andreasson and Lilienthal 2012)"
LEAST_CELLS = 6
"""Cells of a scan below which there is nothing to lay on each other."""


def register_by_cells(problem: RegistrationProblem, method: Ndt3dMethod, progress: Progress) -> PairResult:
    """Register two scans by distributions in cells; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """

    def propose(problem: RegistrationProblem, search: CoarseRegistration) -> PoseProposal:
        return proposed_by_cells(problem, method.cells, search)

    procedure = ProposingProcedure(LABEL, method.matching, method.adjustment, method.surfaces, propose)
    return register_by_proposal(problem, procedure, progress)


def proposed_by_cells(problem: RegistrationProblem, options: CellOptions, search: CoarseRegistration) -> PoseProposal:
    """Lay the distributions of the source on those of the target.

    Parameters
    ----------
    problem
        Features of both scans.
    options
        Cells and starts.
    search
        The search's answer, a possible start.

    Raises
    ------
    TooFewCorrespondencesError
        When a scan has next to no cells with enough points, or no pose lays any on the other's.
    InvalidInputError
        Picked points are asked for as a start.
    """
    target, source = problem.target.surface.points, problem.source.surface.points
    sizes = cell_sizes(options.coarsest_cell_m, options.finest_cell_m, options.steps)
    found = min(cell_distributions(points, sizes[-1]).in_first if len(points) else 0 for points in (target, source))
    if found < LEAST_CELLS:
        raise TooFewCorrespondencesError(found, LEAST_CELLS, "cells with enough points")
    starts = _starts(problem, options, search)
    matches = [match for match in match_cells(target, source, sizes, starts) if match.score.value > 0.0]
    if not matches:
        raise TooFewCorrespondencesError(0, LEAST_CELLS, "cells that lie on each other")
    chosen = best_on_surfaces(problem, [match.pose for match in matches])
    best = matches[chosen]
    step = EstimatorStep(
        "rotation and translation", best.cells, 6, None, len(best.steps), best.steps[-1].step_m if best.steps else 0.0,
        converged=best.converged,
    )  # fmt: skip
    doubts = () if best.converged else ("the climb to the highest score did not settle",)
    return PoseProposal(
        PoseEstimate(best.pose, covariance_of(best)),
        (step,),
        (*_remarks(best, sizes, len(starts)), *_rival(best, matches)),
        doubts,
    )


def _starts(problem: RegistrationProblem, options: CellOptions, search: CoarseRegistration) -> list[RigidTransform]:
    """Give the start that is asked for, and those beside it."""
    if options.start is IcpStart.PICKED:
        raise InvalidInputError("cells.start", "picked points are not known here", "another start")
    start = start_of(problem, IcpOptions(start=options.start), search)
    middle = problem.source.surface.points.mean(axis=0)
    return starts_around(start, start.apply(middle), options.beside_rad, options.beside_m)


def _remarks(best: CellMatch, sizes: list[float], starts: int) -> tuple[str, ...]:
    steps = [sum(step.cell_m == size for step in best.steps) for size in sizes]
    words = ", ".join(f"{count} at {size:.2g} m" for count, size in zip(steps, sizes, strict=True))
    remark = (
        f"{starts} start{'s' if starts > 1 else ''}; {best.cells} cells of the source, steps by their size: {words}; "
        f"score {best.score.value:.1f}, {best.score.value / max(best.cells, 1):.2f} a cell"
    )
    return (remark,)


def _rival(best: CellMatch, matches: list[CellMatch]) -> tuple[str, ...]:
    """Say how good the next best answer is."""
    others = [match for match in matches if match is not best]
    if not others:
        return ()
    rival = others[0]
    turn = np.degrees(float((best.pose.rotation * rival.pose.rotation.inv()).magnitude())) / 0.9
    apart = float(np.linalg.norm(best.pivot_m - rival.pivot_m))
    remark = (
        f"the next best answer, {apart:.1f} m and {turn:.1f} gon away, scores "
        f"{rival.score.value / max(best.score.value, 1e-12):.0%} of it"
    )
    return (remark,)
