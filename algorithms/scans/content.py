"""What a scan holds, in ten numbers: files with the same ones hold the same points, in whatever order and format."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Array, Points, Vector3

BLOCK = 1 << 20
"""Points that are summed at once."""
ROUNDED_M, ROUNDED_SHARE = 1e-3, 1e-4
"""Other formats round coordinates: means may differ by the smaller of this length and this share of the size..."""
ROUNDED_SCATTER = 1e-4
"""...and the scatter by this share of its trace."""


@dataclass(frozen=True, eq=False)
class ScanContent:
    """Moments of the points of a scan; no order of points changes them, and rounding hardly does."""

    points: int
    mean_m: Vector3
    """(3,) in full coordinates [m]."""
    scatter_m2: Array
    """(3, 3) covariance of the coordinates [m2]."""

    def to_json(self) -> dict[str, Any]:
        """Give the members as plain JSON values."""
        return {"points": self.points, "mean_m": self.mean_m.tolist(), "scatter_m2": self.scatter_m2.tolist()}

    @staticmethod
    def from_json(stored: Mapping[str, Any]) -> "ScanContent":
        """Read what `to_json` gave."""
        return ScanContent(stored["points"], np.array(stored["mean_m"]), np.array(stored["scatter_m2"]))


def content_of(points: Points, origin_m: Vector3) -> ScanContent:
    """Sum up the (n, 3) points of a scan, given relative to a local origin [m]."""
    n = len(points)
    starts = range(0, n, BLOCK)
    mean = np.sum([points[start : start + BLOCK].sum(axis=0) for start in starts], axis=0) / n
    scatter = np.zeros((3, 3))
    for start in starts:
        rays = points[start : start + BLOCK] - mean
        scatter += rays.T @ rays
    return ScanContent(n, np.asarray(mean + origin_m), scatter / n)


def same_content(first: ScanContent, second: ScanContent) -> bool:
    """Tell whether two scans hold the same points, but for their order and rounding.

    As many points, in the mean at the same place to a millimetre at most and scattered alike to a ten-thousandth: two
    measurements of one place do not come so near, each has its own number of returns.
    """
    if first.points != second.points:
        return False
    trace = float(np.trace(first.scatter_m2))
    allowed_m = min(ROUNDED_M, ROUNDED_SHARE * trace**0.5)
    near = float(np.linalg.norm(first.mean_m - second.mean_m)) <= allowed_m
    return near and float(np.abs(first.scatter_m2 - second.scatter_m2).max()) <= ROUNDED_SCATTER * trace
