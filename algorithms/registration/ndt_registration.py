"""The work of the method `ndt`: heading and shift from slices, height from what lies flat, estimated from there on."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.arrays import Array, Matrix3, Points
from algorithms.distributions.layer_registration import LayerMatch, cell_sizes, match_layers
from algorithms.distributions.layers import layers_of
from algorithms.distributions.levelling import levelling
from algorithms.errors import TooFewCorrespondencesError
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import Progress
from algorithms.registration.base import PairResult, RegistrationProblem
from algorithms.registration.ndt import LayerOptions, NdtMethod
from algorithms.registration.proposals import (
    PoseProposal,
    ProposingProcedure,
    best_on_surfaces,
    register_by_proposal,
)

LABEL = "Normal distributions in horizontal slices (Dold, Ripperda and Brenner 2007; Biber and Strasser 2003)"
FINALISTS = 12
"""Distinct answers between which the surfaces decide."""
LEAST_POINTS = 50
"""Points of slices below which there is nothing to lay on each other."""
FLAT = 0.95
"""Normals whose vertical part is larger belong to what lies flat."""
GROUND_CELL_M, HEIGHT_BIN_M = 1.0, 0.05
"""Heights are compared in cells of this edge; the height most cells agree on is found to this [m]."""
OPEN_HEIGHT_STD_M, HEIGHT_STD_M = 1.0, 0.05
"""Standard deviation of the height where nothing flat lies in both scans, and where something does [m]."""


def register_by_layers(problem: RegistrationProblem, method: NdtMethod, progress: Progress) -> PairResult:
    """Register two scans by slices; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """

    def propose(problem: RegistrationProblem, _search: CoarseRegistration) -> PoseProposal:
        return proposed_by_layers(problem, method.layers)

    procedure = ProposingProcedure(LABEL, method.matching, method.adjustment, method.surfaces, propose)
    return register_by_proposal(problem, procedure, progress)


def proposed_by_layers(problem: RegistrationProblem, options: LayerOptions) -> PoseProposal:
    """Lay the slices of two scans on each other.

    Parameters
    ----------
    problem
        Features of both scans.
    options
        Slices, cells and starts.

    Raises
    ------
    TooFewCorrespondencesError
        When the slices of a scan hold next to nothing.
    """
    levels = levelling(problem.target), levelling(problem.source)
    target, source = (
        layers_of(features, options.heights_m, options.thickness_m, level)
        for features, level in zip((problem.target, problem.source), levels, strict=True)
    )
    if min(len(target.points), len(source.points)) < LEAST_POINTS:
        raise TooFewCorrespondencesError(min(len(target.points), len(source.points)), LEAST_POINTS, "points of slices")
    sizes = cell_sizes(options.coarsest_cell_m, options.finest_cell_m, options.steps)
    starts = _starts(problem, levels, options.headings)
    matches = match_layers(target, source, sizes, starts, options.reach_m)
    flat = _flat_points(problem.target, levels[0]), _flat_points(problem.source, levels[1])
    matches = matches[:FINALISTS]
    heights = [_height(*flat, Rotation.from_euler("z", match.pose[2]), match.pose[:2]) for match in matches]
    poses = [_between_scans(match, height, levels) for match, (height, _) in zip(matches, heights, strict=True)]
    chosen = best_on_surfaces(problem, poses)
    best, (_, height_std), pose = matches[chosen], heights[chosen], poses[chosen]
    rival = next((match for match in matches if match is not best), None)
    horizontal = _covariance(best)
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = options.levelled_std_rad**2
    order = [3, 4, 2]
    covariance[np.ix_(order, order)] = horizontal
    covariance[5, 5] = height_std**2
    covariance = _turned(covariance, levels[0].inv())
    step = EstimatorStep(
        "heading and horizontal shift", len(source.points), 3, None, best.iterations, best.last_step_m,
        converged=best.converged,
    )  # fmt: skip
    remarks = [
        (
            f"{len(target.points)} and {len(source.points)} points in {target.count} slices; cells of {sizes[0]:g} to "
            f"{sizes[-1]:g} m in {len(sizes)} steps; mean score {best.mean_score:.3f}"
        ),
        (
            "the method sees levelled scanners only; their walls say that they lean by "
            f"{np.degrees(levels[0].magnitude()) / 0.9:.2f} and {np.degrees(levels[1].magnitude()) / 0.9:.2f} gon"
        ),
    ]
    if rival is not None:
        remarks.append(
            f"the next best answer, {np.linalg.norm(rival.pose[:2] - best.pose[:2]):.1f} m and "
            f"{np.degrees(abs(np.angle(np.exp(1j * (rival.pose[2] - best.pose[2]))))) / 0.9:.1f} gon away, scores "
            f"{rival.score.value / max(best.score.value, 1e-12):.0%} of it"
        )
    return PoseProposal(PoseEstimate(pose, covariance), (step,), tuple(remarks))


def _starts(problem: RegistrationProblem, levels: tuple[Rotation, Rotation], headings: int) -> Array:
    """Start with instrument on instrument, in every heading."""
    centres = [
        np.zeros(2) if features.sensor_m is None else level.apply(features.sensor_m)[:2]
        for features, level in zip((problem.target, problem.source), levels, strict=True)
    ]
    starts = []
    for heading in np.linspace(0.0, 2.0 * np.pi, headings, endpoint=False).tolist():
        cosine, sine = np.cos(heading), np.sin(heading)
        turned = np.array([[cosine, -sine], [sine, cosine]]) @ centres[1]
        starts.append([*(centres[0] - turned), heading])
    return np.array(starts)


def _between_scans(match: LayerMatch, height_m: float, levels: tuple[Rotation, Rotation]) -> RigidTransform:
    """Put heading, shift and height together, between the scans as they stood."""
    between = RigidTransform.from_components(
        [match.pose[0], match.pose[1], height_m], Rotation.from_euler("z", match.pose[2])
    )
    return RigidTransform.from_rotation(levels[0].inv()) * between * RigidTransform.from_rotation(levels[1])


def _turned(covariance: Array, rotation: Rotation) -> Array:
    """Tell a covariance of turn and shift in turned axes."""
    both = np.kron(np.eye(2), rotation.as_matrix())
    return np.asarray(both @ covariance @ both.T)


def _covariance(match: LayerMatch) -> Matrix3:
    """Give the covariance of x, y and heading: the points' gradients between two inverse Hessians."""
    values, vectors = np.linalg.eigh(-match.score.hessian)
    inverse = (vectors / np.maximum(values, 1e-9 * max(float(values[-1]), 1e-9))) @ vectors.T
    return np.asarray(inverse @ match.score.outer @ inverse)


def _height(ours: Points, theirs: Array, rotation: Rotation, shift: Array) -> tuple[float, float]:
    """Give the vertical shift that most flat surface agrees on, and its standard deviation [m]."""
    moved = rotation.apply(theirs) + np.array([*shift, 0.0])
    heights = _heights_by_cell(ours)
    differences = [
        found - height for cell, height in _heights_by_cell(moved).items() if (found := heights.get(cell)) is not None
    ]
    if not differences:
        return 0.0, OPEN_HEIGHT_STD_M
    values = np.sort(np.array(differences))
    inside = np.searchsorted(values, values + HEIGHT_BIN_M) - np.arange(len(values))
    first = int(np.argmax(inside))
    return float(values[first : first + int(inside[first])].mean()), HEIGHT_STD_M


def _flat_points(features: ScanFeatures, level: Rotation) -> Points:
    surface = features.surface
    return np.asarray(level.apply(surface.points)[level.apply(surface.normals)[:, 2] > FLAT])


def _heights_by_cell(points: Points) -> dict[tuple[int, int], float]:
    """Give the lowest flat surface in each cell: the ground, not what stands on it."""
    cells = np.floor(points[:, :2] / GROUND_CELL_M).astype(np.int64)
    lowest: dict[tuple[int, int], float] = {}
    for (x, y), height in zip(cells.tolist(), points[:, 2].tolist(), strict=True):
        if height < lowest.get((x, y), np.inf):
            lowest[x, y] = height
    return lowest
