"""The step that coordinates are rounded to, found from the coordinates themselves.

Writers round: LAS to its scale, text to its decimals, single precision to 24 bits, which is 3 cm at 500 km; depth
cameras measure in slices whose thickness grows with the distance. What is rounded to more than its noise does not
scatter any more, and pretends to be exact.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from algorithms.arrays import Array, Scalars, Vector3
from algorithms.scans.scan import Scan

SAMPLE = 100_000
"""So many points of a scan are looked at."""
LEAST_VALUES = 12
"""Fewer different values tell nothing: two floors of an ideal building are no step."""
LEAST_STORAGE_STEPS = 10.0
"""A step is seen where it is so many times what the numbers themselves can tell apart; below that they are the step."""
ON_STEP, LEAST_SHARE = 0.1, 0.98
"""Differences of neighbouring values that are whole multiples of a step to within this share of it; and how many must
be. Of differences that know no step a fifth would be."""
MOST_STEPS = 50.0
"""Differences of more steps are not asked: the error of the step grows with them."""
FEW_GAPS, LEAST_SHARE_OF_FEW = 2000, 0.9
"""So many differences tell the steps that are none at once: of these, this share is never seen by chance."""
QUANTILES = (0.0, 0.01, 0.05, 0.25, 0.5, 0.75)
DIVISORS = (1.0, 2.0, 3.0, 4.0, 5.0)
"""Differences at these quantiles, and these parts of them, are tried as steps."""
POINTS_PER_SLICE = 8.0
"""Where so many points fall on each value, values are slices, whatever lies between them."""
SLICES_IN_STEPS = 1.9
"""Of a common step, so many steps between typical slices: the instrument's slices are thicker than the file's step."""
SAME_IN_STORAGE = 3.0
"""Values that differ by less, in what the numbers can tell apart, are the same."""


@dataclass(frozen=True, eq=False)
class CoordinateSteps:
    """To what the coordinates of a scan are rounded; 0 where nothing is seen of it."""

    axes_m: Vector3
    """(3,) step along each axis of the file [m], of slices that of the typical point (root mean square)."""
    range_m: float = 0.0
    """Step of the distances from the instrument [m]."""
    uneven: Bool[Array, "4"] | None = None
    """(4,) True for axes, and the range, that fall on slices of unequal thickness; None: none does."""

    @property
    def largest_m(self) -> float:
        """Largest of all steps [m]."""
        return max(float(self.axes_m.max()), self.range_m)

    def std_across_m(self, normals: Float64[Array, "n 3"]) -> Scalars:
        """Give what rounding by itself makes single points deviate across surfaces, (n,) [m]: Σ n² s²/12 over axes."""
        variances = np.square(normals) @ np.square(self.axes_m) / 12.0
        return np.asarray(np.sqrt(variances + self.range_m**2 / 12.0))

    @property
    def std_m(self) -> float:
        """Give the same for the worst direction [m]."""
        return float(np.sqrt((np.square(self.axes_m).max() + self.range_m**2) / 12.0))


FULL_PRECISION = CoordinateSteps(np.zeros(3))
"""Coordinates that are not rounded."""


def coordinate_steps(scan: Scan) -> CoordinateSteps:
    """Find to what the coordinates of a scan, in the file's own axes, and its ranges are rounded."""
    points = scan.points[:: max(1, len(scan) // SAMPLE)]
    found = [step_of(points[:, axis] + scan.origin_m[axis]) for axis in range(3)]
    steps = np.array([step for step, _ in found])
    if scan.sensor_m is None:
        return CoordinateSteps(steps, 0.0, np.array([*(own for _, own in found), False]))
    ranges = np.linalg.norm(points - scan.sensor_m, axis=1)
    step, uneven = step_of(ranges, least_m=float(np.linalg.norm(steps)))
    # what is not seen beyond the steps of the axes is theirs
    return CoordinateSteps(
        steps, step if step > np.linalg.norm(steps) else 0.0, np.array([*(own for _, own in found), uneven])
    )


def step_of(values: Scalars, *, least_m: float = 0.0) -> tuple[float, bool]:
    """Find the step that values are multiples of, from the same zero.

    The differences of neighbouring values are multiples of it. Where there is no common one, but many points fall on
    each of few values, these are slices.

    Parameters
    ----------
    values
        (n,) full coordinates along one axis, as stored [m].
    least_m
        What the values cannot tell apart by their origin [m].

    Returns
    -------
    The step [m], at least what the numbers can tell apart, and whether it is that of slices of unequal thickness.
    """
    storage = max(_storage_spacing(values), least_m)
    ordered = np.sort(values)
    new = np.concatenate([[True], np.diff(ordered) > SAME_IN_STORAGE * storage])
    starts = np.flatnonzero(new)
    if len(starts) < LEAST_VALUES:
        return storage, False
    ends = np.append(starts[1:], len(ordered))
    counts = (ends - starts).astype(np.float64)
    if np.average(ordered[ends - 1] - ordered[starts], weights=counts) > SAME_IN_STORAGE * storage:
        return storage, False  # nothing lies between values: they are no values but a continuum
    gaps = np.diff(np.add.reduceat(ordered, starts) / counts)
    common = _common_step(gaps, storage)
    if len(ordered) < POINTS_PER_SLICE * len(starts):
        return max(common, storage), False
    # the thinner of both neighbouring slices: what lies beyond empty space is no neighbour
    thickness = np.minimum(np.append(gaps, np.inf), np.append(np.inf, gaps))
    order = np.argsort(thickness)
    typical = thickness[order][np.searchsorted(np.cumsum(counts[order]), 0.5 * len(ordered))]
    if common > 0.0 and typical < SLICES_IN_STEPS * common:
        return common, False
    return float(np.sqrt(np.average(np.square(thickness), weights=counts))), True


def _storage_spacing(values: Scalars) -> float:
    """Give what the numbers themselves can tell apart: that of single precision where all of them are such numbers."""
    single = values.astype(np.float32)
    if np.array_equal(single.astype(np.float64), values):
        return float(np.sqrt(np.mean(np.square(np.spacing(np.abs(single)).astype(np.float64)))))
    return 8.0 * float(np.spacing(np.abs(values).max()))


def _common_step(gaps: Scalars, storage: float) -> float:
    """Give the largest step of which nearly all gaps are whole multiples; 0 where there is none."""
    tried = np.unique(np.quantile(gaps, QUANTILES, method="lower")[:, None] / np.array(DIVISORS))
    few = gaps[:: max(1, len(gaps) // FEW_GAPS)]
    for step in tried[tried >= LEAST_STORAGE_STEPS * storage][::-1]:
        if _share_on(few, step)[1] < LEAST_SHARE_OF_FEW:
            continue
        refined, share = _share_on(gaps, step)
        if share >= LEAST_SHARE:
            return refined
    return 0.0


def _share_on(gaps: Scalars, step: float) -> tuple[float, float]:
    """Give a step refined by its smallest multiples, and the share of gaps that are whole multiples of it.

    Gaps of many steps are not asked; no share is given where these are more than half.
    """
    near = gaps[gaps < MOST_STEPS * step]
    multiples = np.rint(near / step)
    few = (multiples >= 1.0) & (multiples <= 3.0)
    if len(near) < 0.5 * len(gaps) or not few.any():
        return step, 0.0
    refined = float(np.median(near[few] / multiples[few]))
    multiples = np.rint(near / refined)
    good = (multiples >= 1.0) & (np.abs(near - multiples * refined) < ON_STEP * refined)
    return refined, np.count_nonzero(good) / len(near)
