"""What each line contributes and how well it fits, for the reader (MATH 3.5, 4, 7)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.line_line import LineLine
from algorithms.adjustment.observations.plane_plane import PlanePlane
from algorithms.adjustment.snooping import Change, CorrespondenceState, SnoopingResult
from algorithms.adjustment.testing import NOT_CONTROLLED, ComponentTests
from algorithms.arrays import Array, Flags, Labels, Matrix, Scalars, Vectors2
from algorithms.geometry.angles import GON_PER_RAD


@dataclass(frozen=True, eq=False)
class LineReport:
    """One row for each correspondence, in the order they were given.

    Components are (tilt 1, tilt 2, offset 1, offset 2) in the target line's basis.
    """

    states: Labels
    """(n,) `CorrespondenceState`."""
    angles_rad: Scalars
    """(n,) angle between the moved source line and the target line [rad]."""
    offsets_m: Vectors2
    """(n, 2) offset of the moved source line in the target line's basis, at the middle of the common piece (or of the
    gap) [m]."""
    tilts_rad: Vectors2
    """(n, 2) tilt of the moved source line in the target line's basis [rad]."""
    residuals: Matrix
    """(n, 4) residuals as adjusted: tilts [rad], offsets at the target's anchor [m]."""
    w: Matrix
    """(n, 4) standardised test values, 0 where not controlled or not used."""
    redundancy: Matrix
    """(n, 4) redundancy numbers; 0 for removed lines. Their sum is the redundancy."""
    controlled: Array
    """(n, 4) False where an error cannot be seen; then w is 0 and the detectable error infinite."""
    detectable: Matrix
    """(n, 4) smallest detectable error [rad, m], inf where not controlled."""
    statistics: Scalars
    """(n,) T of the whole line; for removed lines against their prediction."""
    degrees: Scalars
    """(n,) degrees of freedom of T."""
    critical: Scalars
    """(n,) limit of T; inf where nothing is controlled."""
    p_values: Scalars
    """(n,) probability of a larger T in a good line."""


@dataclass(frozen=True, eq=False)
class PlaneReport:
    """One row for each pair of planes, in the order they were given."""

    states: Labels
    """(n,) `CorrespondenceState`."""
    angles_rad: Scalars
    """(n,) angle between the moved source plane and the target plane [rad]."""
    offsets_m: Scalars
    """(n,) distance of the moved source plane from the target plane at the target's centroid [m]."""
    statistics: Scalars
    """(n,) T of the pair; for removed pairs against their prediction."""
    degrees: Scalars
    """(n,) degrees of freedom of T."""
    p_values: Scalars
    """(n,) probability of a larger T in a good pair."""


@dataclass(frozen=True)
class Removal:
    """One change of the set of used correspondences, with its reason."""

    step: int
    """Number of the adjustment after which it happened."""
    change: Change
    correspondence: int
    """Number of the correspondence: lines first, then planes, each in the order given."""
    kind: str
    """``line`` or ``plane``."""
    target_number: int
    source_number: int
    statistic: float
    """T at that step."""
    critical: float
    """Its limit."""
    reason: str
    """In words."""


def line_report(lines: LineLine, result: SnoopingResult, components: ComponentTests, alpha: float) -> LineReport:
    """Gather the figures of each line.

    Parameters
    ----------
    lines
        All correspondences, reduced frames.
    result
        Solution and tests.
    components
        Component tests of the used correspondences; lines come first.
    alpha
        Level of the tests.
    """
    n = len(lines)
    used, rows = result.used[:n], 4 * int(result.used[:n].sum())
    residuals = lines.linearised(result.solution.pose).residuals
    tilts = residuals[:, :2]
    places = _middle_of_common_piece(lines, result.solution.pose)
    redundancy = _spread(components.redundancy[:rows], used, 0.0)
    controlled = _spread(components.controlled[:rows], used, 0.0) > 0.0
    degrees = result.tests.degrees[:n]
    # standardised with the variance that the tests allow for
    root = np.sqrt(result.variance_factor)
    return LineReport(
        states=_states(result, slice(0, n), np.asarray((redundancy < NOT_CONTROLLED).all(axis=1))),
        angles_rad=np.arctan(np.linalg.norm(tilts, axis=1)),
        offsets_m=residuals[:, 2:] + places[:, None] * tilts,
        tilts_rad=tilts,
        residuals=residuals,
        w=_spread(components.w[:rows], used, 0.0) / root,
        redundancy=redundancy,
        controlled=controlled,
        detectable=_spread(components.detectable[:rows], used, np.inf) * root,
        statistics=result.tests.statistics[:n],
        degrees=degrees,
        critical=np.where(degrees > 0, stats.chi2.isf(alpha, np.maximum(degrees, 1.0)), np.inf),
        p_values=result.tests.p_values[:n],
    )


def plane_report(planes: PlanePlane | None, first: int, result: SnoopingResult) -> PlaneReport:
    """Gather the figures of each pair of planes.

    Parameters
    ----------
    planes
        All pairs of planes, reduced frames; None for none.
    first
        Number of the block of the first pair.
    result
        Solution and tests.
    """
    if planes is None:
        none = np.empty(0)
        return PlaneReport(np.empty(0, dtype=np.int32), none, none, none, none, none)
    rows = slice(first, first + len(planes))
    residuals = planes.linearised(result.solution.pose).residuals
    degrees = result.tests.degrees[rows]
    return PlaneReport(
        states=_states(result, rows, degrees == 0),
        angles_rad=np.arctan(np.linalg.norm(residuals[:, :2], axis=1)),
        offsets_m=np.abs(residuals[:, 2]),
        statistics=result.tests.statistics[rows],
        degrees=degrees,
        p_values=result.tests.p_values[rows],
    )


def removals_in_words(
    observations: Sequence[LineLine | PlanePlane], result: SnoopingResult, alpha: float
) -> tuple[Removal, ...]:
    """Tell the history of removals and reinstatements."""
    kinds = ["line" if isinstance(part, LineLine) else "plane" for part in observations for _ in range(len(part))]
    numbers = np.vstack([part.pairs for part in observations])
    residuals = [r for part in observations for r in part.linearised(result.solution.pose).residuals]
    removals = []
    for step in result.steps:
        kind, (target, source) = kinds[step.block], (int(number) for number in numbers[step.block])
        tilt = float(np.arctan(np.linalg.norm(residuals[step.block][:2]))) * GON_PER_RAD
        offset = float(np.linalg.norm(residuals[step.block][2:])) * 1e3
        sign = "exceeds" if step.change is Change.REMOVED else "is within"
        reason = (
            f"T = {step.statistic:.1f} {sign} the limit {step.critical:.2f} ({alpha:.2%}); in the final pose the two "
            f"{kind}s differ by {tilt:.3f} gon and {offset:.1f} mm"
        )
        if step.inseparable_from:
            others = ", ".join(f"{kinds[k]}s ({numbers[k][0] + 1}, {numbers[k][1] + 1})" for k in step.inseparable_from)
            reason += f"; the tests cannot separate this pair from {others}"
        removals.append(
            Removal(step.step, step.change, step.block, kind, target, source, step.statistic, step.critical, reason)
        )
    return tuple(removals)


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


def _spread(stacked: Array, used: Flags, fill: float) -> Array:
    """Lay the rows of used lines (4 each, stacked) into a table of all lines."""
    table = np.full((len(used), 4), fill)
    table[used] = stacked.reshape(-1, 4)
    return table
