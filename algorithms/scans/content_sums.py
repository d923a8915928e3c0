"""Sum up what a scan holds (`content`)."""

import numpy as np

from algorithms.arrays import Points, Vector3
from algorithms.scans.content import ScanContent

BLOCK = 1 << 20
"""Points that are summed at once."""


def content_of(points: Points, origin_m: Vector3) -> ScanContent:
    """Sum up the (n, 3) points of a scan, given relative to a local origin [m]."""
    n = len(points)
    starts = range(0, n, BLOCK)
    mean = np.sum([points[start : start + BLOCK].sum(axis=0) for start in starts], axis=0) / n
    scatter = np.zeros((3, 3))
    for start in starts:
        rays = points[start : start + BLOCK] - mean
        scatter += rays.T @ rays
    return ScanContent(n, tuple((mean + origin_m).tolist()), tuple(map(tuple, (scatter / n).tolist())))
