"""Sum up what a scan holds (`content`)."""

import numpy as np

from algorithms.arrays import Points, Vector3
from algorithms.scans.content import ScanContent

BLOCK = 1 << 20
"""Points that are summed at once."""


class ContentSums:
    """Sums over the points of a scan that comes in pieces."""

    def __init__(self) -> None:
        """Begin with no point."""
        self._points = 0
        self._reference_m = np.zeros(3)
        self._sum_m, self._squares_m2 = np.zeros(3), np.zeros((3, 3))

    def add(self, points: Points, origin_m: Vector3) -> None:
        """Add (n, 3) points, given relative to an origin [m]."""
        if len(points) == 0:
            return
        if self._points == 0:
            # near the points, or squares of coordinates of a country lose what scatters
            self._reference_m = points.mean(axis=0) + origin_m
        shift_m = origin_m - self._reference_m
        for start in range(0, len(points), BLOCK):
            rays = points[start : start + BLOCK] + shift_m
            self._sum_m += rays.sum(axis=0)
            self._squares_m2 += rays.T @ rays
        self._points += len(points)

    @property
    def content(self) -> ScanContent:
        """What was added, of at least one point."""
        mean_m = self._sum_m / self._points
        scatter_m2 = self._squares_m2 / self._points - np.outer(mean_m, mean_m)
        return ScanContent(
            self._points, tuple((mean_m + self._reference_m).tolist()), tuple(map(tuple, scatter_m2.tolist()))
        )


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
