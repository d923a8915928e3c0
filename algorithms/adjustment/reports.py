"""What each line and plane contributes and how well it fits, for the reader (MATH 3.5, 4, 7)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.critical_values import b_method_limit
from algorithms.adjustment.external_reliability import ComponentEffects
from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.options import AdjustmentOptions
from algorithms.adjustment.snooping import CorrespondenceState, SnoopingResult
from algorithms.adjustment.testing import NOT_CONTROLLED, ComponentTests
from algorithms.arrays import Array, Flags, Labels, Matrix, Points, Scalars, Vectors2
from algorithms.geometry.line_pairs_geometry import LinePairs, pair_geometry
from algorithms.probabilities import chi2_isf


@dataclass(frozen=True, eq=False)
class CorrespondenceReport:
    """Tests and reliability, one row for each correspondence in the order given; d components (4 of a line, 3 of a
    plane: two tilts [rad], then offsets [m], in the target feature's basis).

    Where the tests allow for a variance factor, standard deviations, w, T and detectable errors do so too.
    """  # fmt: skip

    states: Labels
    """(n,) `CorrespondenceState`."""
    angles_rad: Scalars
    """(n,) angle between the moved source feature and the target feature [rad] (MATH 3.5)."""
    residuals: Matrix
    """(n, d) residuals as adjusted [rad, m]."""
    residual_std: Matrix
    """(n, d) standard deviations of the residuals, sqrt of the diagonal of C - J Q Jᵀ [rad, m]; inf for removed ones,
    which have none."""
    w: Matrix
    """(n, d) standardised test values, 0 where not controlled or not used (MATH 4.2)."""
    redundancy: Matrix
    """(n, d) redundancy numbers; 0 for removed ones. Their sum over all is the redundancy (MATH 4)."""
    controlled: Array
    """(n, d) False where an error cannot be seen; then w is 0 and the detectable error infinite."""
    detectable: Matrix
    """(n, d) smallest detectable error [rad, m], inf where not controlled (MATH 4.3)."""
    effects: Array
    """(n, d, 6) what an undetected error of that size does to the pose: rotation vector [rad], shift at the lines'
    centroid [m]; 0 where not controlled (MATH 4.3)."""
    global_effects: Matrix
    """(n, d) δ̄ of the same: the change in units of the pose's standard deviations (MATH 4.3)."""
    statistics: Scalars
    """(n,) T of the whole feature; for removed ones against their prediction (MATH 4.4, 4.5)."""
    degrees: Scalars
    """(n,) degrees of freedom of T."""
    critical: Scalars
    """(n,) limit of T; inf where nothing is controlled."""
    critical_b_method: Scalars
    """(n,) limit of T with the non-centrality and power of the one-dimensional test; inf where nothing is controlled
    (MATH 4.4)."""
    p_values: Scalars
    """(n,) probability of a larger T in a good correspondence."""


@dataclass(frozen=True, eq=False)
class LineReport(CorrespondenceReport):
    """The figures of lines; offsets in the residuals are those at the target's anchor."""

    offsets_m: Vectors2
    """(n, 2) offset of the moved source line in the target line's basis, at the middle of the common piece (or of the
    gap) [m] (MATH 3.5)."""
    offset_covariances: Float64[Array, "n 2 2"]
    """(n, 2, 2) covariance of that offset after the adjustment [m²]; zero for removed lines."""
    tilts_rad: Vectors2
    """(n, 2) tilt of the moved source line in the target line's basis [rad]."""
    middles_m: Points
    """(n, 3) the middle of the common piece, on the target line [m]."""
    shortest_distances_m: Scalars
    """(n,) shortest distance of the two lines, endless as in Lichtenstein eq. (4.17) [m] (MATH 1.7). Where two lines
    are all but parallel it lies far away and says little."""


@dataclass(frozen=True, eq=False)
class PlaneReport(CorrespondenceReport):
    """The figures of planes."""

    offsets_m: Scalars
    """(n,) where the moved source plane passes the target's centroid, along the target's normal [m]."""


def line_report(
    lines: LineLine,
    result: SnoopingResult,
    components: ComponentTests,
    effects: ComponentEffects,
    options: AdjustmentOptions,
) -> LineReport:
    """Gather the figures of each line (MATH 3.5, 4.2 to 4.4).

    The angle is arctan of the tilt's length, sin⁻¹|d' × d2|; the standard deviation of a residual is the root of the
    diagonal of S = C - J Q Jᵀ; the limit of T is the quantile 1 - alpha of chi-square with the degrees of freedom that
    are controlled, 18.47 for 0.1 % and four.

    Parameters
    ----------
    lines
        All correspondences, reduced frames.
    result
        Solution and tests; lines come first.
    components, effects
        Component tests of the used correspondences, and effects of what they do not find.
    options
        Levels of the tests.
    """
    pose = result.solution.pose
    residuals = lines.linearised(pose).residuals
    covariances = _residual_covariances(result, 0, slice(0, len(lines)))
    offsets, offset_covariances, places = offsets_in_the_middle(lines, residuals, covariances, pose)
    target, source = lines.target[lines.pairs[:, 0]], lines.source[lines.pairs[:, 1]]
    moved = LinePairs(
        target.anchors, target.directions, pose.apply(source.anchors), pose.rotation.apply(source.directions)
    )
    return LineReport(
        **_tested(residuals, covariances, result, 0, 0, components, effects, options),
        offsets_m=offsets,
        offset_covariances=offset_covariances,
        tilts_rad=residuals[:, :2],
        middles_m=target.anchors + places[:, None] * target.directions,
        shortest_distances_m=pair_geometry(moved).distances_m,
    )


def plane_report(
    planes: PlanePlane,
    line_count: int,
    result: SnoopingResult,
    components: ComponentTests,
    effects: ComponentEffects,
    options: AdjustmentOptions,
) -> PlaneReport:
    """Gather the figures of each pair of planes (MATH 4.2 to 4.4).

    Parameters
    ----------
    planes
        All pairs of planes, reduced frames.
    line_count
        Number of pairs of lines, which come before.
    result, components, effects, options
        As `line_report`.
    """
    residuals = planes.linearised(result.solution.pose).residuals
    covariances = _residual_covariances(result, 1, slice(line_count, line_count + len(planes)))
    return PlaneReport(
        **_tested(residuals, covariances, result, 1, line_count, components, effects, options),
        offsets_m=residuals[:, 2],
    )


def no_planes() -> PlaneReport:
    """Give the report of an adjustment without planes (MATH 7)."""
    none, empty = np.empty(0), np.empty((0, 3))
    return PlaneReport(
        states=np.empty(0, dtype=np.int32),
        angles_rad=none,
        residuals=empty,
        residual_std=empty,
        w=empty,
        redundancy=empty,
        controlled=np.empty((0, 3), dtype=bool),
        detectable=empty,
        effects=np.empty((0, 3, 6)),
        global_effects=empty,
        statistics=none,
        degrees=none,
        critical=none,
        critical_b_method=none,
        p_values=none,
        offsets_m=none,
    )


def offsets_in_the_middle(
    lines: LineLine, residuals: Matrix, covariances: Array, pose: RigidTransform
) -> tuple[Vectors2, Float64[Array, "n 2 2"], Scalars]:
    """Carry offsets from the target's anchor to the middle of the common piece, o + s a for tilt a (MATH 3.5).

    Parameters
    ----------
    lines
        All correspondences.
    residuals
        (n, 4) tilts [rad] and offsets at the anchors [m].
    covariances
        (n, 4, 4) of the residuals.
    pose
        Target from source.

    Returns
    -------
    offsets, covariances
        (n, 2) and (n, 2, 2) in the middle [m].
    places
        (n,) s, where the middle is along the target line, from its anchor [m].
    """
    places = _middle_of_common_piece(lines, pose)
    carry = np.concatenate([places[:, None, None] * np.eye(2), np.broadcast_to(np.eye(2), (len(places), 2, 2))], axis=2)
    offsets = np.einsum("nij,nj->ni", carry, residuals)
    return offsets, np.asarray(carry @ covariances @ np.swapaxes(carry, 1, 2)), places


def _tested(
    residuals: Matrix,
    covariances: Array,
    result: SnoopingResult,
    kind: int,
    first: int,
    components: ComponentTests,
    effects: ComponentEffects,
    options: AdjustmentOptions,
) -> dict[str, Array]:
    """Fill the fields that lines and planes have in common; `kind` counts observation types, `first` blocks."""
    n, d = residuals.shape
    rows = slice(first, first + n)
    used, degrees = result.used[rows], result.tests.degrees[rows]
    root = np.sqrt(result.variance_factor)

    def spread(stacked: Array, fill: float) -> Array:
        table = np.full((n, d, *stacked.shape[1:]), fill)
        table[used] = result.solution.system.split(stacked)[kind]
        return table

    controlled = spread(components.controlled, 0.0) > 0.0
    redundancy = spread(components.redundancy, 0.0)
    nothing_seen = (redundancy < NOT_CONTROLLED).all(axis=1) | (degrees == 0)
    std = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
    limits = np.array([np.inf] + [b_method_limit(k, options.alpha_single, options.power).critical for k in range(1, 7)])
    at_level = np.where(degrees > 0, chi2_isf(options.alpha_single, np.maximum(degrees, 1.0)), np.inf)
    by_b_method = limits[degrees.astype(np.int64)]
    return {
        "states": _states(result, rows, nothing_seen),
        "angles_rad": np.arctan(np.linalg.norm(residuals[:, :2], axis=1)),
        "residuals": residuals,
        "residual_std": np.where(used[:, None], std, np.inf),
        "w": spread(components.w, 0.0) / root,
        "redundancy": redundancy,
        "controlled": controlled,
        "detectable": spread(components.detectable, np.inf) * root,
        "effects": spread(effects.motions, 0.0),
        "global_effects": spread(effects.global_, 0.0),
        "statistics": result.tests.statistics[rows],
        "degrees": degrees,
        "critical": by_b_method if options.b_method else at_level,
        "critical_b_method": by_b_method,
        "p_values": result.tests.p_values[rows],
    }


def _residual_covariances(result: SnoopingResult, kind: int, rows: slice) -> Array:
    """Give C - J Q Jᵀ of the used blocks of one type, times the variance factor; zeros for unused ones."""
    solution, used = result.solution, result.used[rows]
    jacobians = solution.system.split(solution.system.dense_jacobian)[kind]
    left = solution.system.covariances[kind] - jacobians @ solution.cofactors @ np.swapaxes(jacobians, 1, 2)
    table = np.zeros((len(used), *left.shape[1:]))
    table[used] = left * result.variance_factor
    return table


def _states(result: SnoopingResult, rows: slice, not_controlled: Flags) -> Labels:
    used = result.used[rows]
    states = np.full(len(used), int(CorrespondenceState.USED), dtype=np.int32)
    states[result.reinstated[rows]] = int(CorrespondenceState.REINSTATED)
    states[not_controlled] = int(CorrespondenceState.NOT_CONTROLLED)
    states[~used] = int(CorrespondenceState.REMOVED)
    return states


def _middle_of_common_piece(lines: LineLine, pose: RigidTransform) -> Scalars:
    """Give the place along the target line, from its anchor, in the middle between the two inner ends [m]."""
    target, source = lines.target[lines.pairs[:, 0]], lines.source[lines.pairs[:, 1]]
    ends = [np.einsum("ij,ij->i", pose.apply(end) - target.anchors, target.directions) for end in source.end_points]
    first = np.maximum(np.minimum(*ends), target.extents[:, 0])
    last = np.minimum(np.maximum(*ends), target.extents[:, 1])
    return np.asarray(0.5 * (first + last))
