"""The work of the methods `lines` and `planes`: matching, adjustment with correspondences found anew, verification."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.line_adjustment import adjust_lines
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.snooping import CorrespondenceState
from algorithms.arrays import Array, Flags, IndexPairs, OtherIndexPairs
from algorithms.errors import DegenerateGeometryError, TooFewCorrespondencesError
from algorithms.matching.correspondences import GATES, corresponding_lines, corresponding_planes
from algorithms.matching.directions import comes_first
from algorithms.matching.open_shifts import shifted_by_lines
from algorithms.progress import Progress
from algorithms.registration.base import FineRegistration, PairResult, PairStatus, RegistrationProblem
from algorithms.registration.final_pose import of_features, open_shift
from algorithms.registration.lines import LinesMethod
from algorithms.registration.method import Method
from algorithms.registration.pair_verdict import contradictions, largest_hidden_shift_m, searched
from algorithms.registration.planes import PlanesMethod
from algorithms.registration.verdict import Answer, judged


@dataclass(frozen=True)
class FeatureUse:
    """Which features carry the pose, and how far corresponding ones may lie apart."""

    lines: bool = True
    planes: bool = True
    gates: tuple[tuple[float, float], ...] = GATES
    """Largest angle [rad] and distance [m] of corresponding features in each round."""


def register_by_lines(problem: RegistrationProblem, method: LinesMethod, progress: Progress) -> PairResult:
    """Register two scans by lines; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """
    return _by_features(problem, FeatureUse(planes=method.planes), method, progress)


def register_by_planes(problem: RegistrationProblem, method: PlanesMethod, progress: Progress) -> PairResult:
    """Register two scans by planes alone; every failure becomes a result with its status and reasons.

    Parameters
    ----------
    problem
        Features of both scans.
    method
        Options.
    progress
        Is told the steps.
    """
    return _by_features(problem, FeatureUse(lines=False), method, progress)


def _by_features(problem: RegistrationProblem, use: FeatureUse, method: Method, progress: Progress) -> PairResult:
    progress.report(0.0, "matching")
    coarse = searched(problem, method.matching)
    if isinstance(coarse, PairResult):
        return coarse
    progress.report(0.6, "adjustment")
    try:
        fine = adjusted_features(problem, use, method.adjustment, coarse.target_from_source)
    except TooFewCorrespondencesError as error:
        return PairResult(
            PairStatus.REJECTED, (f"a pose was found, but nothing to adjust it by: {error}",), coarse, None, None
        )
    except DegenerateGeometryError as error:
        return PairResult(
            PairStatus.DEGENERATE, (f"a pose was found, but not adjusted: {error}",), coarse, None, None,
            free_directions=error.free_directions, advice=error.advice,
        )  # fmt: skip
    progress.report(0.9, "verification")
    label = "lines+planes" if use.lines and use.planes else "lines" if use.lines else "planes"
    final = of_features(problem, fine, label, f"the method uses {label.replace('+', ' and ')} alone")
    doubts = contradictions(problem, coarse, fine)
    answer = Answer(final, fine, largest_hidden_shift_m(fine.adjustment), doubts)
    return judged(problem, coarse, answer, method.matching)


def adjusted_features(
    problem: RegistrationProblem, use: FeatureUse, options: AdjustmentOptions, start: RigidTransform
) -> FineRegistration:
    """Adjust, find the correspondences anew in the better pose, and so on until they stay the same.

    Parameters
    ----------
    problem
        Features of both scans.
    use
        Which of them carry the pose.
    options
        Of the adjustment.
    start
        Target from source between the reduced frames, good to about the first gate.

    Raises
    ------
    TooFewCorrespondencesError
        Below two corresponding features.
    DegenerateGeometryError
        When those there are hold the pose so weakly that the adjustment runs away.
    """
    fine = _in_rounds(problem, use, options, start)
    shifted = _along_open_shift(problem, fine) if use.lines else None
    if shifted is not None:
        fine = _in_rounds(problem, use, options, shifted)
    return _with_moved_features(problem, use, options, fine)


def _in_rounds(
    problem: RegistrationProblem, use: FeatureUse, options: AdjustmentOptions, start: RigidTransform
) -> FineRegistration:
    """Adjust with the correspondences near the start, then with those near the better pose, and so on.

    What one round found wrong is doubted in the next, which saves finding it wrong again, one at a time.
    """
    pose = start
    fine: FineRegistration | None = None
    for gate in use.gates:
        lines, planes = _corresponding(problem, use, pose, gate)
        if fine is not None and np.array_equal(fine.lines, lines) and np.array_equal(fine.planes, planes):
            break
        doubted = None if fine is None else _found_wrong(fine, lines, planes)
        fine = _fine(problem, options, pose, lines, planes, doubted)
        pose = fine.adjustment.pose.target_from_source
    if fine is None:
        raise TooFewCorrespondencesError(0, 2, "lines and planes")
    return fine


def _along_open_shift(problem: RegistrationProblem, fine: FineRegistration) -> RigidTransform | None:
    """Move the pose along the one shift that its features leave open to where more lines of both scans meet, if so."""
    pose = fine.adjustment.pose
    direction = open_shift(pose)
    if direction is None:
        return None
    return shifted_by_lines(problem.target, problem.source, pose.target_from_source, direction)


def _corresponding(
    problem: RegistrationProblem, use: FeatureUse, pose: RigidTransform, gate: tuple[float, float]
) -> tuple[IndexPairs, OtherIndexPairs]:
    """Find the lines and planes that both scans see, of the kinds in use."""
    limits = {"max_angle_rad": gate[0], "max_distance_m": gate[1]}
    return (
        corresponding_lines(problem.target, problem.source, pose, **limits) if use.lines else _no_pairs(),
        corresponding_planes(problem.target, problem.source, pose, **limits) if use.planes else _no_pairs(),
    )


def _fine(
    problem: RegistrationProblem,
    options: AdjustmentOptions,
    start: RigidTransform,
    lines: IndexPairs,
    planes: OtherIndexPairs,
    doubted: Array | None = None,
) -> FineRegistration:
    """Adjust the pose to corresponding lines and planes."""
    target, source = problem.target, problem.source
    adjustment = adjust_lines(
        target.lines,
        source.lines,
        lines,
        start,
        planes=PlanePlane(target.planes, source.planes, planes),
        target_photo_covariances=target.photo_covariances,
        source_photo_covariances=source.photo_covariances,
        doubted=doubted,
        from_source=not comes_first(target, source),
        options=options,
    )
    return FineRegistration(
        lines,
        planes,
        adjustment,
        adjustment.pose_a_posteriori.moved_to_origins(target.origin_m, source.origin_m),
        adjustment.centroid_m + target.origin_m,
    )


def _with_moved_features(
    problem: RegistrationProblem, use: FeatureUse, options: AdjustmentOptions, fine: FineRegistration
) -> FineRegistration:
    """Add pairs that lie farther apart than the last gate, as doubted ones: they bend nothing, but are reported.

    All others take part at first, whatever the rounds before found of them. A door or cupboard that was moved by some
    centimetres between the scans shows so, instead of vanishing.
    """
    pose = fine.adjustment.pose.target_from_source
    near = _corresponding(problem, use, pose, use.gates[0])
    lines, planes = _others(near[0], fine.lines), _others(near[1], fine.planes)
    if len(lines) + len(planes) == 0 and fine.adjustment.doubted_count == 0:
        return fine
    sizes = [len(fine.lines), len(lines), len(fine.planes), len(planes)]
    return _fine(
        problem,
        options,
        pose,
        np.vstack([fine.lines, lines]),
        np.vstack([fine.planes, planes]),
        doubted=np.repeat([False, True, False, True], sizes),
    )


def _found_wrong(fine: FineRegistration, lines: IndexPairs, planes: OtherIndexPairs) -> Array | None:
    """Say of lines, then planes, which pairs an adjustment removed; None if there are none of them."""
    wrong = [
        _are_among(pairs, known[states == int(CorrespondenceState.REMOVED)])
        for pairs, known, states in (
            (lines, fine.lines, fine.adjustment.lines.states),
            (planes, fine.planes, fine.adjustment.planes.states),
        )
    ]
    doubted = np.concatenate(wrong)
    return doubted if doubted.any() else None


def _are_among(pairs: IndexPairs, others: OtherIndexPairs) -> Flags:
    return np.asarray((pairs[:, None] == others[None]).all(axis=2).any(axis=1))


def _others(pairs: IndexPairs, known: OtherIndexPairs) -> Array:
    """Keep the pairs of which neither feature is paired already."""
    taken = np.isin(pairs[:, 0], known[:, 0]) | np.isin(pairs[:, 1], known[:, 1])
    return pairs[~taken]


def _no_pairs() -> IndexPairs:
    return np.empty((0, 2), dtype=np.int64)
