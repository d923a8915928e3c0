"""Is a pair two measurements, or one and its copy? A copy fits perfectly, and says nothing of how good a pose is."""

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.arrays import Array, Points

TRIED = 500
"""Points of the smaller cloud that are looked for in the other one."""
NEARER = 0.2
"""A point is found again when the nearest one is so many times as far away as the second nearest, or nearer. Points of
another measurement lie anywhere between: (0.2)^2, 4 % of them do."""
SAME_SHARE = 0.5
"""From this share of points on that are found again it is the same measurement: thinned, cut or moved."""
BLOCK = 1 << 20
"""Points that are looked at at once."""
ROUNDS = 3
"""So often the pose is improved with the points that were found."""
LEAST_FOUND = 20
"""Points without which nothing is said."""


def shared_points(
    smaller: Points, larger: Float64[Array, "m 3"], larger_from_smaller: RigidTransform, reach_m: float
) -> float:
    """Give the share of the points of one cloud that are found again in another one, 0..1.

    Parameters
    ----------
    smaller, larger
        (n, 3) and (m, 3) points; of the smaller cloud some are tried [m].
    larger_from_smaller
        Pose that lays one on the other; it is improved here, as far as points are found again.
    reach_m
        How far the nearest points may be [m]: some spacings of the larger cloud.
    """
    tried = smaller[:: max(1, len(smaller) // TRIED)]
    pose, share = larger_from_smaller, 0.0
    around = _around(pose.apply(tried), larger, 2.0 * reach_m)
    if len(around) < LEAST_FOUND:
        return 0.0
    tree = cKDTree(around)
    for _ in range(ROUNDS):
        moved = pose.apply(tried)
        distances, rows = (np.asarray(each) for each in tree.query(moved, k=2))
        near = distances[:, 0] < reach_m
        if int(near.sum()) < LEAST_FOUND:
            return 0.0
        found = near & (distances[:, 0] <= NEARER * np.minimum(distances[:, 1], reach_m))
        share = len(np.unique(rows[found, 0])) / len(tried)  # each is another one
        used = found if int(found.sum()) >= LEAST_FOUND else near
        pose = _fitted(around[rows[used, 0]], tried[used])
    return share


def _around(tried: Points, larger: Float64[Array, "m 3"], reach_m: float) -> Float64[Array, "k 3"]:
    """Give the distinct points of the larger cloud that are near one of those tried."""
    tree = cKDTree(tried)
    found = []
    for start in range(0, len(larger), BLOCK):
        some = larger[start : start + BLOCK]
        distances = np.asarray(tree.query(some, distance_upper_bound=reach_m)[0])
        found.append(some[np.isfinite(distances)])
    return np.unique(np.concatenate(found), axis=0)


def _fitted(fixed: Points, moved: Points) -> RigidTransform:
    """Lay points on their partners by least squares."""
    middle, own = fixed.mean(axis=0), moved.mean(axis=0)
    rotation, _ = Rotation.align_vectors(fixed - middle, moved - own)
    return RigidTransform.from_components(middle - rotation.apply(own), rotation)
