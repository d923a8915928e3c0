"""Fine registration by matched lines: the rigorous pose with everything its reader needs (MATH 3.1, 4, 5, 7)."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.exchanged import snooped_from_source
from algorithms.adjustment.external_reliability import component_effects
from algorithms.adjustment.mount_errors import MountError, with_less_trust
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.pair_adjustment import adjust_pair, rank_of
from algorithms.adjustment.pair_problem import PairProblem, by_station
from algorithms.adjustment.principal_motions import PrincipalMotion, principal_motions
from algorithms.adjustment.problem import SourcePlaneCovariances, TargetPlaneCovariances
from algorithms.adjustment.rank import UserOrigins, WeakDirection, centred_frame, weak_directions
from algorithms.adjustment.removals import Removal, removals_in_words
from algorithms.adjustment.reports import LineReport, PlaneReport, line_report, no_planes, plane_report
from algorithms.adjustment.snooping import SnoopingRules, adjust_and_snoop
from algorithms.adjustment.testing import (
    GlobalTest,
    GlobalVerdict,
    component_tests,
    global_test,
    normal_critical_value,
    tau_critical_value,
)
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, IndexPairs, Matrices3, Vector3
from algorithms.errors import InvalidInputError, TooFewCorrespondencesError
from algorithms.geometry.lines import Lines
from algorithms.geometry.poses import OptionalTriple, PoseEstimate

DEFAULT_OPTIONS = AdjustmentOptions()


@dataclass(frozen=True, eq=False)
class LineAdjustment:
    """Result of adjusting one pose to matched lines (MATH 3.1, 4, 5, 7)."""

    pose: PoseEstimate
    """Pose with its a-priori covariance (sigma0 = 1). Where the rank is below 6 its null space is set, and the pose
    along it is that of the start value."""
    rank: int
    """Determined parameters, of 6."""
    free_directions: tuple[str, ...]
    """What is free, in words; empty at rank 6."""
    advice: str
    """What to add where the rank is below 6."""
    ghost_ratio: float
    """Information on the weakest shift over what noise alone would pretend; below 10 the shift is free (MATH 5.2)."""
    weak: tuple[WeakDirection, ...]
    """Determined, but badly."""
    observation_count: int
    """Conditions: four for each used line."""
    independent_condition_count: int
    """Rank of their covariance: less than the conditions where lines share planes."""
    redundancy: int
    """Independent conditions minus determined parameters."""
    omega: float
    """Weighted sum of squared residuals."""
    sigma0: float | None
    """Standard deviation of unit weight a posteriori; None without redundancy."""
    global_test: GlobalTest
    w_critical: float
    """Limit of |w| with sigma0 = 1 known a priori."""
    tau_critical: float | None
    """Limit of |w| / sigma0 where sigma0 is estimated (Pope's tau); None below redundancy 2."""
    t_critical: float
    """Limit of the line statistic T with four degrees of freedom."""
    test_variance_factor: float
    """Variance factor that tests of single lines and planes allow for: 1 where the scans' own noise explains most
    residuals, else the robust estimate from all correspondences, so that uneven walls are not taken for blunders."""
    lines: LineReport
    planes: PlaneReport
    removals: tuple[Removal, ...]
    """Removed and reinstated correspondences in order."""
    mount_errors: tuple[MountError, ...]
    """Mounts of photos that contradict what else is seen and are trusted less than stated, in order."""
    principal_motions: tuple[PrincipalMotion, ...]
    """The determined motions, worst first, with a-priori standard deviations (MATH 5.1)."""
    undetected: Array
    """(m, 6) what errors that just stay undetected in the components of used features do to the pose, as of
    `CorrespondenceReport.effects`, but of the components in which the adjustment was decided (`from_source`)."""
    doubted_count: int
    """Correspondences that took part only if they fitted (`doubted` of `adjust_lines`)."""
    centroid_m: Vector3
    """(3,) centroid of the used features (ends of lines, centroids of planes) of the scan that decides, the target
    unless `from_source` [m]."""
    radius_m: float
    """Rms distance of those points from their centroid [m]."""
    centroid_std_m: OptionalTriple
    """Standard deviations of the position at the centroid [m]."""
    options: AdjustmentOptions
    """Levels and limits as used."""
    iterations: int
    """Rounds of the last adjustment."""
    converged: bool

    @property
    def variance_factor(self) -> float:
        """Factor on the a-priori covariance: sigma0² where the global test finds the residuals too large, else 1.

        Below that limit sigma0 differs from 1 by chance only, and taking max(1, sigma0²) would enlarge every second
        covariance for nothing (MATH 4.1).
        """
        if self.sigma0 is None or self.global_test.verdict is not GlobalVerdict.TOO_LARGE:
            return 1.0
        return self.sigma0**2

    @property
    def pose_a_posteriori(self) -> PoseEstimate:
        """Pose with the covariance multiplied by `variance_factor` (MATH 4.1)."""
        return self.pose.with_covariance_scaled(self.variance_factor)


def adjust_lines(
    target: Lines,
    source: Lines,
    correspondences: IndexPairs,
    start: RigidTransform,
    *,
    planes: PlanePlane | None = None,
    target_plane_covariances: TargetPlaneCovariances | None = None,
    source_plane_covariances: SourcePlaneCovariances | None = None,
    target_photo_covariances: Float64[Array, "target_photos 6 6"] | None = None,
    source_photo_covariances: Float64[Array, "source_photos 6 6"] | None = None,
    doubted: Bool[Array, "pairs"] | None = None,
    from_source: bool = False,
    options: AdjustmentOptions = DEFAULT_OPTIONS,
) -> LineAdjustment:
    """Adjust the pose to matched lines, remove wrong correspondences, and say what is determined and how well.

    Gauss-Helmert model with four conditions for each line and three for each plane (MATH 3.1), both sides uncertain;
    tests one at a time (MATH 4.5), and rank (MATH 5). Lines that are intersections of planes are correlated where they
    share a plane (MATH 3.3). With the plane covariances given, their joint covariance is used; left out, lines count as
    independent, which promises too much for rooms.

    Parameters
    ----------
    target, source
        Lines of both scans in their frames.
    correspondences
        (n, 2) numbers of target line and source line, one to one.
    start
        Target from source, within the convergence region of the linearisation (a few degrees are ample).
    planes
        Planes that both scans see, as further observations. Their covariances then also correlate the lines, whose
        parents they are.
    target_plane_covariances, source_plane_covariances
        Only without `planes`: (p, 3, 3) of the planes that `Lines.parents` counts, (a1, a2, b) of `Planes.covariances`.
    target_photo_covariances, source_photo_covariances
        (q, 6, 6) of the mounts of the photos that `Lines.photos` counts (rotation vector, translation; MATH 2.5). Left
        out, lines of one photo count as independent, which promises too much.
    doubted
        True for correspondences, lines first, then planes, that take no part unless they fit what the others say: such
        as planes some centimetres apart, which may have been moved between the scans. They are reported in any case.
    from_source
        Let the opposite direction decide (`exchanged`): the pose is the inverse of what exchanged scans give without.
    options
        Significance levels and limits.

    Raises
    ------
    TooFewCorrespondencesError
        Below two correspondences, lines and planes together.
    InvalidInputError
        When a line occurs twice, the number of a line or plane does not exist, or a covariance is not positive
        definite.
    """
    _check_one_to_one(correspondences, len(target), len(source), "line")
    lines = LineLine(target, source, correspondences)
    observations: tuple[LineLine | PlanePlane, ...] = (lines,)
    if planes is not None:
        _check_one_to_one(planes.pairs, len(planes.target), len(planes.source), "plane")
        observations = (lines, planes)
        target_plane_covariances, source_plane_covariances = planes.target.covariances, planes.source.covariances
    _check_planes(target, target_plane_covariances, "target")
    _check_planes(source, source_plane_covariances, "source")
    matches = PairProblem(
        observations,
        by_station(target_plane_covariances, source_plane_covariances),
        by_station(target_photo_covariances, source_photo_covariances),
    )
    if len(matches) < 2:
        raise TooFewCorrespondencesError(len(matches), 2, "lines" if planes is None else "lines and planes")
    origins = UserOrigins(matches.target_points().mean(axis=0), matches.source_points().mean(axis=0))
    problem = matches.about(origins.target_m, origins.source_m)
    reduced_start = RigidTransform.from_components(
        np.asarray(start.translation) - (origins.target_m - start.rotation.apply(origins.source_m)), start.rotation
    )
    rules = SnoopingRules(
        options.alpha_single,
        options.max_removed_share,
        options.robust_variance,
        options.power if options.b_method else None,
    )
    reduced: list[LineLine | PlanePlane] = [part.about(origins.target_m, origins.source_m) for part in observations]
    if from_source:
        result, undetected = snooped_from_source(
            problem, tuple(reduced), reduced_start, rules, origins, power=options.power,
            max_iterations=options.max_iterations, suspicious=doubted,
        )  # fmt: skip
    else:
        adjust = partial(adjust_pair, origins=origins, max_iterations=options.max_iterations)
        result = adjust_and_snoop(problem, Unknowns.of_pair(reduced_start), rules, adjust, doubted)
    problem = with_less_trust(problem, result.mounts)
    solution, used = result.solution, problem.selected(result.used)
    rank = rank_of(used, solution, origins)
    reduced_pose = PoseEstimate(solution.pose, solution.cofactors, rank.null_space)
    points = solution.pose.apply(used.source_points()) if from_source else used.target_points()
    frame = centred_frame(points)
    components = component_tests(solution, options.alpha_single, options.power)
    effects = component_effects(solution, components, frame.centroid, result.variance_factor)
    undetected = undetected if from_source else effects.motions
    reduced_lines = lines.about(origins.target_m, origins.source_m)
    of_lines, of_planes = line_report(reduced_lines, result, components, effects, options), no_planes()
    if planes is not None:
        reduced_planes = planes.about(origins.target_m, origins.source_m)
        of_planes = plane_report(reduced_planes, len(lines), result, components, effects, options)
    return LineAdjustment(
        pose=reduced_pose.moved_to_origins(origins.target_m, origins.source_m),
        rank=rank.rank,
        free_directions=rank.free_directions,
        advice=rank.advice,
        ghost_ratio=rank.ratio,
        weak=weak_directions(frame, solution.pose, solution.cofactors, rank),
        observation_count=len(solution.system.residuals),
        independent_condition_count=solution.whitening.rank,
        redundancy=solution.redundancy,
        omega=solution.omega,
        sigma0=solution.sigma0,
        global_test=global_test(solution.omega, solution.redundancy, options.alpha_global),
        w_critical=normal_critical_value(options.alpha_single),
        tau_critical=tau_critical_value(options.alpha_single, solution.redundancy),
        t_critical=rules.limit(4.0),
        test_variance_factor=result.variance_factor,
        lines=replace(of_lines, middles_m=of_lines.middles_m + origins.target_m),
        planes=of_planes,
        removals=removals_in_words(problem, reduced, result, options.alpha_single),
        mount_errors=result.mounts,
        principal_motions=principal_motions(reduced_pose, frame.centroid, frame.radius_m),
        undetected=undetected,
        doubted_count=0 if doubted is None else int(doubted.sum()),
        centroid_m=frame.centroid + origins.target_m,
        radius_m=frame.radius_m,
        centroid_std_m=reduced_pose.position_std_m(frame.centroid),
        options=options,
        iterations=solution.iterations,
        converged=solution.converged,
    )


def _check_one_to_one(pairs: IndexPairs, target_count: int, source_count: int, kind: str) -> None:
    for column, count, name in ((0, target_count, "target"), (1, source_count, "source")):
        numbers = pairs[:, column]
        if len(numbers) and (numbers.min() < 0 or numbers.max() >= count):
            raise InvalidInputError("correspondences", f"a {name} {kind} number is not in 0..{count - 1}")
        values, counts = np.unique(numbers, return_counts=True)
        if (counts > 1).any():
            twice = ", ".join(str(value) for value in values[counts > 1])
            raise InvalidInputError(
                "correspondences", f"{name} {kind} {twice} occurs more than once", "match one to one"
            )


def _check_planes(lines: Lines, plane_covariances: Matrices3 | None, name: str) -> None:
    if plane_covariances is None or len(lines) == 0:
        return
    of_planes = (lines.parents >= 0).all(axis=1)
    if of_planes.any() and lines.parents[of_planes].max() >= len(plane_covariances):
        raise InvalidInputError(f"{name} plane covariances", "a line depends on a plane that has none")
