"""Move a pose along a shift that surfaces leave open to where lines, or planes, of both scans lie on each other.

On the front of a house the surfaces hardly tell the shift along it, so that a pose found by them may lie farther off
than corresponding lines are looked for. Every pair of lines that look alike and cross the open direction votes for the
shift that lays one on the other, edges of photos that measure nothing included; the shift that most lines agree on is
taken, unless another one is nearly as good.

Far apart, two scans see the ground about themselves and nothing of it in common. Whether it is one plane they cannot
know: a pose in which it is stays undetermined in height, but is a better guess than where a search left it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Scalars, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.matching.correspondences import lines_near
from algorithms.matching.directions import comes_first
from algorithms.matching.line_evidence import COMMON_SHARE, FOUND_ANGLE_RAD, FOUND_DISTANCE_M, with_witnesses
from algorithms.matching.line_pairs import described_lines

MOST_SHIFT_M, REACH_M = 0.3, 0.6
"""Poses farther apart than the former are compared in the search; shifts up to the latter are counted, lest the best
one that is left wins where the right one is out of reach."""
LEAST_CROSSING = 0.5
"""Sine of the least angle between a line and the open direction."""
AGREEING_M = 0.005
"""Shifts so near to each other agree."""
LEAST_AGREEING, LEAST_LEAD = 4, 2.0
"""So many lines must agree, and so many times as many as on any other shift."""

ACROSS = 0.9
"""Cosine of the largest angle between the open direction and the normal of a plane that stands across it."""
PARALLEL_RAD = 0.0035
"""Planes that are one are parallel within so much, and those whose direction is known less well tell nothing."""
UNEVEN_RAD = 5e-4
"""Standard deviation of the direction of a plane as it goes on beyond what a scan sees of it: none is so even."""
LEAST_PLANE_LEAD = 2.0
"""So many times as much area must agree on the shift as on any other."""


@dataclass(frozen=True)
class PlaneShift:
    """A shift by planes that both scans see in different places."""

    shift_m: float
    """Along the open direction [m]."""
    std_m: float
    """Its standard deviation if they are one plane [m]."""
    planes: int
    """Pairs that agree on it."""


def shift_by_planes(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, direction: Vector3
) -> PlaneShift | None:
    """Give the shift of the source on which most area of planes agrees, or None where they do not single one out.

    Parameters
    ----------
    target, source
        Features of the two scans.
    pose
        Target from source, right but for the shift.
    direction
        (3,) unit direction of the open shift, target frame.
    """
    ours, theirs = target.planes, source.planes
    normals, middles = pose.rotation.apply(theirs.normals), pose.apply(theirs.centroids)
    tilts = [np.sqrt(np.einsum("nii->n", each.covariances[:, :2, :2])) for each in (ours, theirs)]
    angles = np.linalg.norm(ours.normals[:, None] - normals[None], axis=2)
    across = (np.abs(ours.normals @ direction) >= ACROSS) & (tilts[0] <= PARALLEL_RAD)
    i, j = np.nonzero((angles <= PARALLEL_RAD) & across[:, None] & (tilts[1] <= PARALLEL_RAD))
    mean = 0.5 * (ours.normals[i] + normals[j])
    arms = middles[j] - ours.centroids[i]
    # both planes go on to the middle between them, half the distance each
    heights = 0.5 * np.einsum("ni,ni->n", ours.normals[i] + normals[j], arms)
    shifts = -heights / (mean @ direction)
    reach = 0.5 * np.linalg.norm(arms, axis=1)
    variances = ours.covariances[i, 2, 2] + theirs.covariances[j, 2, 2]
    variances = variances + reach**2 * (tilts[0][i] ** 2 + tilts[1][j] ** 2 + 2.0 * UNEVEN_RAD**2)
    areas = np.minimum(ours.areas_m2[i], theirs.areas_m2[j])
    near = np.abs(shifts) <= REACH_M
    shifts, variances, areas = shifts[near], variances[near], areas[near]
    if len(shifts) == 0:
        return None
    agree = np.abs(shifts[:, None] - shifts) <= 2.0 * np.sqrt(variances[:, None] + variances)
    weights = agree @ areas
    best = int(np.argmax(weights))
    if abs(shifts[best]) > MOST_SHIFT_M or weights[best] < LEAST_PLANE_LEAD * weights[~agree[best]].max(initial=0.0):
        return None
    # by area, not by precision: a sill that happens to lie on another one is measured best
    shares = np.where(agree[best], areas, 0.0) / areas[agree[best]].sum()
    return PlaneShift(float(shares @ shifts), float(np.sqrt(shares**2 @ variances)), int(np.count_nonzero(agree[best])))


def shifted_by_lines(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, direction: Vector3
) -> RigidTransform | None:
    """Shift the source so that most lines agree, or give None where they do not single out one shift.

    Parameters
    ----------
    target, source
        Features of the two scans.
    pose
        Target from source, right but for the shift.
    direction
        (3,) unit direction of the open shift, target frame.
    """
    if not comes_first(target, source):
        found = shifted_by_lines(source, target, pose.inv(), pose.rotation.inv().apply(direction))
        return None if found is None else found.inv()
    shifts, ours, theirs = _votes(target, source, pose, direction)
    if len(shifts) == 0:
        return None
    agreeing = np.abs(shifts[:, None] - shifts) <= AGREEING_M
    counts = np.array([min(len(np.unique(ours[near])), len(np.unique(theirs[near]))) for near in agreeing])
    best = int(np.argmax(counts))
    if abs(shifts[best]) > MOST_SHIFT_M:
        return None
    others = counts[np.abs(shifts - shifts[best]) > 2.0 * AGREEING_M]
    if counts[best] < max(LEAST_AGREEING, LEAST_LEAD * others.max(initial=0)):
        return None
    shift = float(np.median(shifts[agreeing[best]]))
    return RigidTransform.from_translation(shift * direction) * pose


def _votes(
    target: ScanFeatures, source: ScanFeatures, pose: RigidTransform, direction: Vector3
) -> tuple[Scalars, Int64[Array, "k"], Int64[Array, "k"]]:
    """Give the shift that lays lines on each other, and the lines' numbers in both scans, for each of k pairs."""
    first, second = described_lines(with_witnesses(target)), described_lines(with_witnesses(source))
    near = lines_near(first, second, pose, max_angle_rad=FOUND_ANGLE_RAD, max_distance_m=REACH_M + FOUND_DISTANCE_M)
    i, j = near.pairs.T
    a, b = first.lines[i], second.lines[j]
    middles = pose.apply(np.mean(b.end_points, axis=0)) if len(j) else np.zeros((0, 3))
    crossing = _across(np.broadcast_to(direction, (len(i), 3)), a.directions)
    squares = np.einsum("ni,ni->n", crossing, crossing)
    gaps = _across(a.anchors - middles, a.directions)
    shifts = np.einsum("ni,ni->n", gaps, crossing) / np.maximum(squares, LEAST_CROSSING**2)
    rest = np.linalg.norm(gaps - shifts[:, None] * crossing, axis=1)
    good = (squares >= LEAST_CROSSING**2) & (np.abs(shifts) <= REACH_M) & (rest <= FOUND_DISTANCE_M)
    good &= near.overlaps_m >= COMMON_SHARE * np.minimum(a.lengths, b.lengths)
    return shifts[good], i[good], j[good]


def _across(vectors: Float64[Array, "k 3"], directions: Float64[Array, "k 3"]) -> Float64[Array, "k 3"]:
    """Take away what lies along directions."""
    return np.asarray(vectors - np.einsum("ni,ni->n", vectors, directions)[:, None] * directions)
