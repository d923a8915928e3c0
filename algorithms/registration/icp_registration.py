"""The work of the methods `icp-point` and `icp-d2`: their own iteration from a start, and the estimate after it."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.closest_points.d2_tree import D2Tree
from algorithms.closest_points.iteration import ErrorKind, IterationLimits, IterationResult, iterated
from algorithms.closest_points.motions import best_motion
from algorithms.closest_points.surface_model import SurfaceModel
from algorithms.errors import TooFewCorrespondencesError
from algorithms.geometry.poses import PoseEstimate
from algorithms.geometry.rotations import cross_matrix
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import Progress
from algorithms.registration.base import ConvergenceStep, PairResult, RegistrationProblem
from algorithms.registration.icp_d2 import IcpD2Method
from algorithms.registration.icp_options import IcpOptions, IcpStart
from algorithms.registration.icp_point import IcpPointMethod
from algorithms.registration.proposals import PoseProposal, ProposingProcedure, register_by_proposal

LABELS = {
    ErrorKind.POINT: "Iterative closest points, point to point (Besl and McKay 1992; closed form of Horn 1987)",
    ErrorKind.PLANE: "Iterative closest points, point to plane (Hofer and Pottmann 2004, equation 20)",
    ErrorKind.D2: "Iterative closest points, squared-distance approximants (Hofer and Pottmann 2004, equation 21)",
}
LEAST_PICKED = 3


def register_point_to_point(problem: RegistrationProblem, method: IcpPointMethod, progress: Progress) -> PairResult:
    """Register two scans by closest points; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans, of which the surfaces are used.
    method
        Options.
    progress
        Is told the steps.
    """
    return _by_iteration(problem, ErrorKind.POINT, method, progress)


def register_by_approximants(problem: RegistrationProblem, method: IcpD2Method, progress: Progress) -> PairResult:
    """Register two scans by squared-distance approximants; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans, of which the surfaces are used.
    method
        Options.
    progress
        Is told the steps.
    """
    return _by_iteration(problem, ErrorKind.D2, method, progress, method.iteration.tree_cell_m)


def _by_iteration(
    problem: RegistrationProblem,
    kind: ErrorKind,
    method: IcpPointMethod | IcpD2Method,
    progress: Progress,
    tree_cell_m: float = 0.0,
) -> PairResult:
    def propose(problem: RegistrationProblem, search: CoarseRegistration) -> PoseProposal:
        start = start_of(problem, method.iteration, search)
        return proposed_by_iteration(problem, start, method.iteration, kind, tree_cell_m)

    procedure = ProposingProcedure(LABELS[kind], method.matching, method.adjustment, method.surfaces, propose)
    return register_by_proposal(problem, procedure, progress)


def start_of(problem: RegistrationProblem, options: IcpOptions, search: CoarseRegistration) -> RigidTransform:
    """Give the pose between the reduced frames to start from.

    Parameters
    ----------
    problem
        Both scans, and what is known of their poses.
    options
        Which start is wanted.
    search
        The search's answer.

    Raises
    ------
    TooFewCorrespondencesError
        When points should be picked or poses given, and too few are.
    """
    if options.start is IcpStart.MATCHING:
        return search.target_from_source
    if options.start is IcpStart.APPROXIMATE:
        known = None if problem.priors is None else problem.priors.target_from_source
        if known is None:
            raise TooFewCorrespondencesError(0, 1, "approximate poses of both stations")
        return known
    if options.start is IcpStart.IDENTITY:
        motion = RigidTransform.identity()
    else:
        picked = np.array(options.picked_points, dtype=np.float64).reshape(-1, 6)
        if len(picked) < LEAST_PICKED:
            raise TooFewCorrespondencesError(len(picked), LEAST_PICKED, "picked points")
        motion = best_motion(picked[:, :3], picked[:, 3:], np.ones(len(picked)))
    files = PoseEstimate(motion, np.zeros((6, 6)))
    return files.moved_to_origins(-problem.target.origin_m, -problem.source.origin_m).target_from_source


def proposed_by_iteration(
    problem: RegistrationProblem,
    start: RigidTransform,
    options: IcpOptions,
    kind: ErrorKind,
    tree_cell_m: float = 0.0,
) -> PoseProposal:
    """Iterate from a start.

    Parameters
    ----------
    problem
        Both scans.
    start
        Target from source between the reduced frames.
    options
        Correspondences and end.
    kind
        What is minimised.
    tree_cell_m
        Edge of the smallest cells of the d2-tree; 0: closest points are searched every time [m].

    Raises
    ------
    TooFewCorrespondencesError
        When next to nothing lies near the other surface.
    """
    target, source = problem.target.index, problem.source.index
    surface = SurfaceModel.of(target.points, target.normals)
    limits = IterationLimits(
        options.max_distance_m, options.max_angle_rad, options.max_iterations, options.least_step_m
    )
    points, normals = source.points[: options.max_points], source.normals[: options.max_points]
    tree = D2Tree(surface, tree_cell_m, options.max_distance_m) if tree_cell_m > 0.0 else None
    result = iterated(surface, points, normals, start, kind, limits, tree)
    pairs = result.steps[-1].pairs
    step = EstimatorStep(
        "rotation and translation", pairs * (3 if kind is ErrorKind.POINT else 1), 6, result.variance_m2**0.5,
        len(result.steps), result.steps[-1].step_m, converged=result.converged,
    )  # fmt: skip
    doubts = () if result.converged else (f"the iteration did not settle in {len(result.steps)} steps",)
    convergence = tuple(ConvergenceStep(each.misfit_m, each.step_m, each.pairs) for each in result.steps)
    remarks = _remarks(result)
    if tree is not None:
        remarks = (*remarks, f"{tree.cell_count} cells of the d2-tree were filled")
    return PoseProposal(_claimed(result), (step,), remarks, doubts, convergence, result.linear_rate, result.order)


def _claimed(result: IterationResult) -> PoseEstimate:
    """Claim what its own normal equations say, as if all distances were independent."""
    cofactors = result.variance_m2 * np.linalg.pinv(result.normal_matrix, hermitian=True)
    # velocities turn about the target's origin: the translation of the pose is moved by the turn as well
    lever = np.eye(6)
    lever[3:, :3] = -cross_matrix(np.asarray(result.pose.translation))
    return PoseEstimate(result.pose, lever @ cofactors @ lever.T)


def _remarks(result: IterationResult) -> tuple[str, ...]:
    rate, order = result.linear_rate, result.order
    words = [f"{len(result.steps)} iterations; misfit {1e3 * result.variance_m2**0.5:.1f} mm at last"]
    if rate is not None:
        words.append(f"steps shrink by a factor of {rate:.2f} from one to the next (median of the second half)")
    if order is not None:
        words.append(f"order of convergence {order:.1f} (1 is linear, 2 quadratic)")
    return tuple(words)
