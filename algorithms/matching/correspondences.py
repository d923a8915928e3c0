"""Which line is which line, and which plane is which, once the pose is roughly known."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, IndexPairs, Scalars
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.planes import Planes
from algorithms.geometry.rotations import rotation_matrix
from algorithms.matching.directions import comes_first
from algorithms.matching.line_pairs import DescribedLines, described_lines

GATES = ((0.035, 0.10), (0.02, 0.05), (0.02, 0.05), (0.02, 0.05))
"""Largest angle [rad] and distance [m] of corresponding features in each round; the pose improves in between."""
MAX_GAP_M = 0.5
"""Pieces of one line seen from two stations may be this far apart along the line [m]: each scan sees its own piece."""
MAX_BISECTOR_ANGLE_RAD = np.radians(15.0)
MAX_RADIUS_DIFFERENCE = 0.1
"""Radii of one pipe agree within this share of the larger, or within a centimetre."""
LEAST_COMMON_SHARE = 0.5
"""So much of the smaller piece must lie on the larger one: walls are not flat enough to compare different pieces."""


@dataclass(frozen=True, eq=False)
class NearLines:
    """k pairs of alike lines that lie on each other."""

    pairs: IndexPairs
    """(k, 2) numbers (target line, source line); a line may occur several times."""
    angles_rad: Scalars
    """(k,) angles between them [rad]."""
    distances_m: Scalars
    """(k,) distances in the middle of the common piece or of the gap [m]."""
    overlaps_m: Scalars
    """(k,) lengths of the common pieces, negative for a gap [m]."""

    def __getitem__(self, which: Flags) -> "NearLines":
        """Select pairs by a mask."""
        return NearLines(self.pairs[which], self.angles_rad[which], self.distances_m[which], self.overlaps_m[which])


def corresponding_lines(
    target: ScanFeatures,
    source: ScanFeatures,
    target_from_source: RigidTransform,
    *,
    max_angle_rad: float,
    max_distance_m: float,
) -> IndexPairs:
    """Find the lines that both scans see.

    Two lines correspond when each is the other's nearest: directions and distance (in the middle of the piece both
    share) within the limits, pieces overlapping or nearly so, edges made of planes that look the same way, axes of
    equal radius.

    Parameters
    ----------
    target, source
        Features of the two scans.
    target_from_source
        Pose [m].
    max_angle_rad, max_distance_m
        Largest angle and distance.

    Returns
    -------
    (k, 2) numbers (target line, source line), one-to-one, by rising target number.
    """
    limits = {"max_angle_rad": max_angle_rad, "max_distance_m": max_distance_m}
    if not comes_first(target, source):
        return _exchanged(corresponding_lines(source, target, target_from_source.inv(), **limits))
    near = lines_near(described_lines(target), described_lines(source), target_from_source, **limits)
    near = near[near.overlaps_m >= -MAX_GAP_M]
    cost = np.full((len(target.lines), len(source.lines)), np.inf)
    cost[near.pairs[:, 0], near.pairs[:, 1]] = (near.distances_m / max_distance_m) ** 2 + (
        near.angles_rad / max_angle_rad
    ) ** 2
    return mutual_best(cost)


def lines_near(
    ours: DescribedLines,
    theirs: DescribedLines,
    target_from_source: RigidTransform,
    *,
    max_angle_rad: float,
    max_distance_m: float,
) -> NearLines:
    """Find all pairs of lines that look alike and lie on each other in a pose; O(n m).

    Parameters
    ----------
    ours, theirs
        Lines of the target and of the source scan.
    target_from_source
        Pose [m].
    max_angle_rad, max_distance_m
        Largest angle, and largest distance in the middle of the common piece or of the gap.
    """
    rotation = rotation_matrix(target_from_source)
    directions = theirs.lines.directions @ rotation.T
    anchors = target_from_source.apply(theirs.lines.anchors) if len(theirs.lines) else theirs.lines.anchors
    cosines = ours.lines.directions @ directions.T
    angles = np.arccos(np.clip(np.abs(cosines), 0.0, 1.0))
    i, j = np.nonzero((angles <= max_angle_rad) & alike_lines(ours, theirs, rotation))
    along = ours.lines.directions[i]
    starts = np.einsum("ij,ij->i", anchors[j] - ours.lines.anchors[i], along)
    reach = theirs.lines.extents[j] * np.sign(cosines[i, j])[:, None] + starts[:, None]
    low = np.maximum(ours.lines.extents[i, 0], reach.min(axis=1))
    high = np.minimum(ours.lines.extents[i, 1], reach.max(axis=1))
    middle = ours.lines.anchors[i] + (0.5 * (low + high))[:, None] * along
    offset = middle - anchors[j]
    across = offset - np.einsum("ij,ij->i", offset, directions[j])[:, None] * directions[j]
    distances = np.linalg.norm(across, axis=1)
    near = distances <= max_distance_m
    i, j = i[near], j[near]
    return NearLines(np.column_stack([i, j]), angles[i, j], distances[near], (high - low)[near])


def alike_lines(ours: DescribedLines, theirs: DescribedLines, rotation: Array) -> Array:
    """Say which lines can be the same by what they are made of, after a rotation target from source, (n, m)."""
    same_kind = ours.kinds[:, None] == theirs.kinds[None, :]
    edge = ~ours.are_axes[:, None]
    bisectors = ours.bisectors @ (theirs.bisectors @ rotation.T).T > np.cos(MAX_BISECTOR_ANGLE_RAD)
    difference = np.abs(ours.sizes[:, None] - theirs.sizes[None, :])
    larger = np.maximum(ours.sizes[:, None], theirs.sizes[None, :])
    radii = difference <= np.maximum(MAX_RADIUS_DIFFERENCE * larger, 0.01)
    openings = difference <= MAX_BISECTOR_ANGLE_RAD
    return np.asarray(same_kind & np.where(edge, bisectors & openings, radii))


def corresponding_planes(
    target: ScanFeatures,
    source: ScanFeatures,
    target_from_source: RigidTransform,
    *,
    max_angle_rad: float,
    max_distance_m: float,
) -> IndexPairs:
    """Find the planes that both scans see.

    Oriented normals and the distance of each plane at the other's centroid must agree within the limits, and the
    bounded pieces must overlap by half of the smaller; each must be the other's nearest.

    Parameters
    ----------
    target, source
        Features of the two scans.
    target_from_source
        Pose [m].
    max_angle_rad, max_distance_m
        Largest angle and distance.

    Returns
    -------
    (k, 2) numbers (target plane, source plane), one-to-one, by rising target number.
    """
    ours, theirs = target.planes, source.planes
    if len(ours) == 0 or len(theirs) == 0:
        return np.empty((0, 2), dtype=np.int64)
    if not comes_first(target, source):
        limits = {"max_angle_rad": max_angle_rad, "max_distance_m": max_distance_m}
        return _exchanged(corresponding_planes(source, target, target_from_source.inv(), **limits))
    normals = theirs.normals @ rotation_matrix(target_from_source).T
    centroids = target_from_source.apply(theirs.centroids)
    angles = np.arccos(np.clip(ours.normals @ normals.T, -1.0, 1.0))
    between = centroids[None, :, :] - ours.centroids[:, None, :]
    on_ours = np.abs(np.einsum("ijk,ik->ij", between, ours.normals))
    on_theirs = np.abs(np.einsum("ijk,jk->ij", between, normals))
    # With a small overlap one of the two distances is extrapolated far beyond the plane's own piece.
    distances = np.minimum(on_ours, on_theirs)
    i, j = np.nonzero((angles <= max_angle_rad) & (distances <= max_distance_m))
    shares, depths = _common_pieces(ours, theirs, target_from_source, np.column_stack([i, j]))
    usable = shares >= LEAST_COMMON_SHARE
    i, j, depths = i[usable], j[usable], depths[usable]
    cost = np.full(angles.shape, np.inf)
    cost[i, j] = (
        (distances[i, j] / max_distance_m) ** 2 + (angles[i, j] / max_angle_rad) ** 2
        - 0.5 * np.minimum(depths, 2.0)  # pieces that overlap by metres are surely the same
    )  # fmt: skip
    return mutual_best(cost)


def _exchanged(pairs: IndexPairs) -> IndexPairs:
    """Give pairs (source, target) as (target, source), by rising target number."""
    return pairs[np.argsort(pairs[:, 1], kind="stable")][:, ::-1]


def mutual_best(cost: Array) -> IndexPairs:
    """Pair row and column that are each other's cheapest, infinite costs excluded; (k, 2), by rising row."""
    if cost.size == 0:
        return np.empty((0, 2), dtype=np.int64)
    best_column, best_row = np.argmin(cost, axis=1), np.argmin(cost, axis=0)
    rows = np.arange(len(cost))
    good = np.isfinite(cost[rows, best_column]) & (best_row[best_column] == rows)
    return np.column_stack([rows[good], best_column[good]]).astype(np.int64)


def _common_pieces(
    ours: Planes, theirs: Planes, target_from_source: RigidTransform, pairs: IndexPairs
) -> tuple[Scalars, Scalars]:
    """Measure how far the boxes around two bounded pieces overlap in the target plane.

    Returns
    -------
    shares
        (n,) common area over the area of the smaller box, 0..1.
    depths
        (n,) smaller side of the common box, 0 where there is none [m].
    """
    shares, depths = np.zeros(len(pairs)), np.zeros(len(pairs))
    own_counts, counts = np.diff(ours.boundary_splits), np.diff(theirs.boundary_splits)
    usable = np.flatnonzero((own_counts[pairs[:, 0]] > 0) & (counts[pairs[:, 1]] > 0))
    if len(usable) == 0:
        return shares, depths
    i, j = pairs[usable].T
    owners = np.repeat(np.arange(len(theirs)), counts)
    corners = theirs.centroids[owners] + np.einsum("nij,nj->ni", theirs.bases[owners], theirs.boundary)
    corners = target_from_source.apply(corners)
    # the corners of each pair's source plane in the axes of its target plane
    starts = np.cumsum(counts[j]) - counts[j]
    pair = np.repeat(np.arange(len(j)), counts[j])
    which = np.arange(len(pair)) - starts[pair] + theirs.boundary_splits[j][pair]
    other = np.einsum("nij,ni->nj", ours.bases[i][pair], corners[which] - ours.centroids[i][pair])
    boxes = np.minimum.reduceat(other, starts), np.maximum.reduceat(other, starts)
    filled = np.flatnonzero(own_counts)
    own_low, own_high = np.zeros((len(ours), 2)), np.zeros((len(ours), 2))
    own_low[filled] = np.minimum.reduceat(ours.boundary, ours.boundary_splits[filled])
    own_high[filled] = np.maximum.reduceat(ours.boundary, ours.boundary_splits[filled])
    common = np.minimum(own_high[i], boxes[1]) - np.maximum(own_low[i], boxes[0])
    smaller = np.minimum(np.prod(own_high[i] - own_low[i], axis=1), np.prod(boxes[1] - boxes[0], axis=1))
    depths[usable] = np.maximum(common.min(axis=1), 0.0)
    shares[usable] = np.prod(np.maximum(common, 0.0), axis=1) / np.maximum(smaller, 1e-12)
    return shares, depths
