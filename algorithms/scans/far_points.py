"""Few points far from everything else: glints, birds, wrong echoes, broken records. They would rule every extent.

No figure of a scan may hang on the farthest of its points: voxels, rasters and origins follow from extents. So isolated
groups of few points are left out before anything else is done, and counted.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Flags, Indices, Points, Vector3
from algorithms.scans.scan import Scan, ScanGrid

SAMPLE = 20_000
"""Of so many points the middle of a scan and its size are told."""
GAP_IN_SIZES, LEAST_GAP_M = 8.0, 2.0
"""Groups are apart when cells of so many times the median distance from the middle, and of this edge, tell them
apart."""
LEAST_LINK = 8
"""Cells of fewer points join no others: a thread of single points does not make what is far part of the scan."""
FEW, FEW_SHARE, MOST_SHARE = 1_000, 0.005, 0.1
"""A group of so many points, or of this share of all, is part of the scan wherever it is, if it is no more than..."""
LEAST_SURFACE = 40
"""...and so is a smaller one from this number on if it is surface."""
NEIGHBOURS, FLATNESS, BREADTH = 12, 0.1, 0.002
"""Surface is where the neighbours of most points spread in two directions, and across them by less than this share of
the variance of the second: points that fill space do it less, points on a line have no second direction."""
LONGEST_RANGE_M, LONGEST_IN_SIZES = 10_000.0, 100.0
"""No instrument measures farther [m] (and, where coordinates are in another unit, none so many times the size of what
it has measured most of): a group of few points beyond is no surface."""
NEAR_M = 1_000.0
"""Scans whose middle is nearer to the origin of their coordinates keep it."""


@dataclass(frozen=True, eq=False)
class FarPoints:
    """The points of a scan that lie far from everything."""

    rows: Indices
    """(k,) which they are, ascending."""
    farthest_m: float
    """Distance of the farthest one from the middle of the scan [m]; 0 without any."""

    def __len__(self) -> int:
        return len(self.rows)

    def in_words(self) -> str | None:
        """Say it; None without any."""
        return None if len(self) == 0 else far_points_in_words(len(self), self.farthest_m)


def far_points_in_words(count: int, farthest_m: float) -> str:
    """Say how many points were left out, and how far away they were."""
    if count == 1:
        return f"1 isolated point lies far from all others, {farthest_m:.0f} m away: it is left out"
    return f"{count} isolated points lie far from all others, up to {farthest_m:.0f} m away: they are left out"


def find_far_points(points: Points) -> FarPoints:
    """Find the isolated groups of few points far from the bulk of a scan.

    Space is cut into cells of several times the scan's size (its median distance from its middle); occupied cells that
    touch make a group. The largest group is the scan. Another one belongs to it if it has many points, or if some
    dozens of them are surface within what an instrument can measure, as a facade far down a street.

    Parameters
    ----------
    points
        (n, 3) [m].
    """
    sample = points[:: max(1, len(points) // SAMPLE)]
    middle = np.median(sample, axis=0)
    size = float(np.median(np.linalg.norm(sample - middle, axis=1)))
    gap = max(GAP_IN_SIZES * size, LEAST_GAP_M)
    outside = np.flatnonzero(_beyond(points, middle, 1.5 * gap))
    if len(outside) == 0:
        return FarPoints(outside, 0.0)
    group, members = _groups(points[outside], middle, gap)
    inside = len(points) - len(outside)
    few = min(max(FEW, FEW_SHARE * len(points)), MOST_SHARE * len(points))
    # group 0 is that of the innermost cells, even if all its points are inside
    counts = np.bincount(group, minlength=members)
    counts[0] += inside
    counts[int(np.argmax(counts))] = len(points)
    longest = max(LONGEST_RANGE_M, LONGEST_IN_SIZES * size)
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(members + 1))
    least = min(LEAST_SURFACE, few)
    left_out = [outside[counts[group] < least]]
    for number in np.flatnonzero((counts >= least) & (counts < few)):
        rows = outside[order[starts[number] : starts[number + 1]]]
        near = float(np.linalg.norm(points[rows] - middle, axis=1).min(initial=np.inf)) <= longest
        if len(rows) < NEIGHBOURS or not near or not _is_surface(points[rows]):
            left_out.append(rows)
    found = np.sort(np.concatenate(left_out))
    farthest = float(np.linalg.norm(points[found] - middle, axis=1).max(initial=0.0))
    return FarPoints(found, farthest)


def without_far_points(scan: Scan) -> tuple[Scan, FarPoints]:
    """Leave out the isolated points of a scan; its local origin moves where it lay amid them."""
    far = find_far_points(scan.points)
    if len(far) == 0:
        return scan, far
    keep = np.ones(len(scan), dtype=np.bool_)
    keep[far.rows] = False
    points = scan.points[keep]
    shift = np.zeros(3)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0)) + scan.origin_m
    wanted = np.zeros(3) if np.linalg.norm(centre) < NEAR_M else np.round(centre)
    if np.linalg.norm(wanted - scan.origin_m) > NEAR_M:
        shift = scan.origin_m - wanted
    kept = replace(
        scan,
        points=points + shift,
        origin_m=scan.origin_m - shift,
        grid=None if scan.grid is None else ScanGrid(_renumbered(scan.grid.index, keep)),
        intensity=None if scan.intensity is None else scan.intensity[keep],
        color=None if scan.color is None else scan.color[keep],
        times_s=None if scan.times_s is None else scan.times_s[keep],
        sensor_m=None if scan.sensor_m is None else scan.sensor_m + shift,
    )
    return kept, far


def _beyond(points: Points, middle: Vector3, reach: float) -> Flags:
    """Say which points lie outside of a cube about the middle."""
    beyond = np.zeros(len(points), dtype=np.bool_)
    for axis in range(3):
        beyond |= np.abs(points[:, axis] - middle[axis]) > reach
    return beyond


def _groups(points: Points, middle: Vector3, edge: float) -> tuple[Int64[Array, "n"], int]:
    """Gather the points whose cells touch: the number of each one's group, 0 amid the scan, and how many there are."""
    most = 2.0**19  # farther cells are one: only what is near must be told apart
    cells = np.clip(np.rint((points - middle) / edge), -most, most).astype(np.int64) + int(most)
    keys, cell_of_point, counts = np.unique(
        (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2], return_inverse=True, return_counts=True
    )
    places = np.stack([keys >> 42, (keys >> 21) & (2**21 - 1), keys & (2**21 - 1)], axis=1).astype(np.float64)
    core = np.array(list(np.ndindex(3, 3, 3)), dtype=np.float64) - 1.0 + most  # the cube that was not looked at
    places = np.vstack([core, places])
    full = np.concatenate([np.ones(len(core), dtype=np.bool_), counts >= LEAST_LINK])
    pairs = cKDTree(places).query_pairs(1.8, output_type="ndarray")  # the 26 neighbours
    joined = pairs[full[pairs].all(axis=1)]
    links = coo_array((np.ones(len(joined), dtype=bool), (joined[:, 0], joined[:, 1])), shape=(len(places),) * 2)
    count, labels = connected_components(links, directed=False)
    first = labels[0]
    labels = np.where(labels == first, 0, np.where(labels == 0, first, labels))
    for here, there in (pairs.T, pairs.T[::-1]):  # cells of few points belong to what they touch, first to group 0
        touches = ~full[here] & full[there]
        for of_first in (False, True):
            chosen = touches & ((labels[there] == 0) == of_first)
            labels[here[chosen]] = labels[there[chosen]]
    return labels[len(core) :][cell_of_point].astype(np.int64), int(count)


def _is_surface(points: Points) -> bool:
    """Tell whether points lie on surface: most neighbourhoods are flat and broad."""
    neighbours = cKDTree(points).query(points, k=NEIGHBOURS)[1]
    rays = points[neighbours] - points[neighbours].mean(axis=1, keepdims=True)
    variances = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", rays, rays))
    flat = (variances[:, 0] < FLATNESS * variances[:, 1]) & (variances[:, 1] > BREADTH * variances[:, 2])
    return bool(np.mean(flat) > 0.5)


def _renumbered(index: Array, keep: Flags) -> Array:
    """Give the grid of the points that are kept."""
    numbers = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
    return np.where(index >= 0, numbers[index], np.int32(-1))
