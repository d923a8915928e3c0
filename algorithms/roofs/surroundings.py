"""What stands above its surroundings: a roof does along its eaves, terrain and a yard do not (Kager 2003, 2.2)."""

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points
from algorithms.deviations.signed_distances import inside_polygon

REACH_M, STATION_M = 2.5, 1.0
"""How far from the rim points are compared, and how far apart along it [m]."""
LEAST_POINTS = 3
"""Inside, and outside, where a place of the rim tells anything."""
LOW = 0.25
"""Outside the ground is this quantile of the heights: plants stand on it."""


def share_above(points: Points, outline: Array, least_height_m: float) -> float | None:
    """Give the share of a plan's rim along which what is inside stands above what is outside.

    Ground that rises towards the plan does so by less, within so short a reach, and a terrace only on one side.

    Parameters
    ----------
    points
        (n, 3) of the site [m].
    outline
        (k, 2) corners of the plan in order [m].
    least_height_m
        From how much on it stands above [m].

    Returns
    -------
    Of the places along the rim that have points inside and outside; None where there is no such place.
    """
    stations = _along(outline)
    low, high = stations.min(axis=0) - REACH_M, stations.max(axis=0) + REACH_M
    near = points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)]
    if len(near) == 0:
        return None
    inside = inside_polygon(near[:, :2], outline)
    told, above = 0, 0
    for members in cKDTree(near[:, :2]).query_ball_point(stations, REACH_M):
        which = np.asarray(members, dtype=np.int64)
        within, beside = near[which[inside[which]], 2], near[which[~inside[which]], 2]
        if min(len(within), len(beside)) >= LEAST_POINTS:
            told += 1
            above += bool(np.median(within) - np.quantile(beside, LOW) >= least_height_m)
    return above / told if told else None


def _along(outline: Array) -> Array:
    """Give places evenly along each side (n, 2)."""
    parts = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        count = max(1, round(float(np.hypot(*(end - start))) / STATION_M))
        parts.append(start + (end - start) * ((np.arange(count) + 0.5) / count)[:, None])
    return np.concatenate(parts)
