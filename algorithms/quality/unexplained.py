"""Surface that one scan has where the other instrument looked through, piece by piece: what moved, or what is wrong."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.scans.surface_index import EvidenceLimits, seen_through

GAP_SPACINGS = 2.0
"""Points that are no farther apart than so many times their spacing belong to one piece."""
LEAST_POINTS = 5
"""Fewer points are no piece: noise at rims."""
MOST_PIECES = 10


@dataclass(frozen=True, eq=False)
class UnexplainedPiece:
    """Connected surface of one scan that stands where the other instrument looked through."""

    in_target: bool
    """Whether the target scan shows it; else the source."""
    centre_m: Vector3
    """(3,) mean of its points in the coordinates of the file of the scan that shows it [m]."""
    area_m2: float
    """About how much surface it is: a square of the points' spacing for each [m2]."""
    range_m: float
    """Mean distance from the instrument that looked through it [m]."""


def unexplained_pieces(
    moved: ScanFeatures,
    fixed: ScanFeatures,
    fixed_from_moved: RigidTransform,
    limits: EvidenceLimits,
    *,
    explained: Flags,
    in_target: bool,
) -> list[UnexplainedPiece]:
    """List the pieces of a scan's surface that stand in the other's free space, the largest first. O(n log n).

    What was seen behind them must not fit the plane of the piece: a low instrument that measures nothing near itself
    looks along rough ground over ground that only others see, and meets it no farther off than its noise.

    Parameters
    ----------
    moved, fixed
        The scan whose surface is asked about, and the one whose instrument looked.
    fixed_from_moved
        Pose in the reduced frames [m].
    limits
        Margins of free space.
    explained
        (n,) True for points of the index of `moved` that lie on the other's surface.
    in_target
        Whether `moved` is the target.

    Returns
    -------
    At most `MOST_PIECES`; none where the other instrument's position is unknown.
    """
    own, other = moved.index, fixed.index
    free = seen_through(fixed_from_moved, own.points, own.normals, other, limits, across_m=limits.max_distance_m)
    points = own.points[~explained & free]
    if len(points) < LEAST_POINTS:
        return []
    pairs = cKDTree(points).query_pairs(GAP_SPACINGS * own.spacing_m, output_type="ndarray")
    links = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    labels = connected_components(links, directed=False)[1]
    counts = np.bincount(labels)
    ranges = np.linalg.norm(fixed_from_moved.apply(points) - other.sensor_m, axis=1)
    largest = [k for k in np.argsort(-counts, kind="stable")[:MOST_PIECES].tolist() if counts[k] >= LEAST_POINTS]
    return [
        UnexplainedPiece(
            in_target,
            np.asarray(points[labels == k].mean(axis=0) + moved.origin_m),
            float(counts[k]) * own.spacing_m**2,
            float(ranges[labels == k].mean()),
        )
        for k in largest
    ]
