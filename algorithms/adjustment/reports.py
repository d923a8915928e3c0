"""What each line contributes and how well it fits, for the reader (MATH 3.5, 4, 7)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations.line_line import LineLine
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
    p_values: Scalars
    """(n,) probability of a larger T in a good line."""


@dataclass(frozen=True)
class Removal:
    """One change of the set of used correspondences, with its reason."""

    step: int
    """Number of the adjustment after which it happened."""
    change: Change
    correspondence: int
    """Row in the list of correspondences."""
    target_line: int
    source_line: int
    statistic: float
    """T at that step."""
    critical: float
    """Its limit."""
    reason: str
    """In words."""


def line_report(lines: LineLine, result: SnoopingResult, components: ComponentTests) -> LineReport:
    """Gather the figures of each line.

    Parameters
    ----------
    lines
        All correspondences, reduced frames.
    result
        Solution and tests.
    components
        Component tests of the used correspondences.
    """
    residuals = lines.linearised(result.solution.pose).residuals
    tilts = residuals[:, :2]
    places = _middle_of_common_piece(lines, result.solution.pose)
    redundancy = _spread(components.redundancy, result.used, 0.0)
    return LineReport(
        states=_states(result, redundancy),
        angles_rad=np.arctan(np.linalg.norm(tilts, axis=1)),
        offsets_m=residuals[:, 2:] + places[:, None] * tilts,
        tilts_rad=tilts,
        residuals=residuals,
        w=_spread(components.w, result.used, 0.0),
        redundancy=redundancy,
        controlled=_spread(components.controlled, result.used, 0.0) > 0.0,
        detectable=_spread(components.detectable, result.used, np.inf),
        statistics=result.tests.statistics,
        degrees=result.tests.degrees,
        p_values=result.tests.p_values,
    )


def removals_in_words(lines: LineLine, result: SnoopingResult, alpha: float) -> tuple[Removal, ...]:
    """Tell the history of removals and reinstatements."""
    residuals = lines.linearised(result.solution.pose).residuals
    removals = []
    for step in result.steps:
        target, source = (int(number) for number in lines.pairs[step.block])
        tilt = float(np.arctan(np.linalg.norm(residuals[step.block, :2]))) * GON_PER_RAD
        offset = float(np.linalg.norm(residuals[step.block, 2:])) * 1e3
        sign = "exceeds" if step.change is Change.REMOVED else "is within"
        reason = (
            f"target line {target} and source line {source}: T = {step.statistic:.1f} {sign} the limit "
            f"{step.critical:.2f} ({alpha:.2%}); in the final pose they differ by {tilt:.3f} gon and {offset:.1f} mm"
        )
        if step.inseparable_from:
            others = ", ".join(f"({lines.pairs[k, 0]}, {lines.pairs[k, 1]})" for k in step.inseparable_from)
            reason += f"; the tests cannot separate this pair from {others}"
        removals.append(
            Removal(step.step, step.change, step.block, target, source, step.statistic, step.critical, reason)
        )
    return tuple(removals)


def _states(result: SnoopingResult, redundancy: Matrix) -> Labels:
    states = np.full(len(result.used), int(CorrespondenceState.USED), dtype=np.int32)
    states[result.reinstated] = int(CorrespondenceState.REINSTATED)
    states[(redundancy < NOT_CONTROLLED).all(axis=1)] = int(CorrespondenceState.NOT_CONTROLLED)
    states[~result.used] = int(CorrespondenceState.REMOVED)
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
