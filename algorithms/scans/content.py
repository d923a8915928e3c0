"""What a scan holds, in ten numbers: files with the same ones hold the same points, in whatever order and format.

Plain numbers: the web process, which compares them, loads no numerical library.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

ROUNDED_M, ROUNDED_SHARE = 1e-3, 1e-4
"""Other formats round coordinates: means may differ by the smaller of this length and this share of the size..."""
ROUNDED_SCATTER = 1e-4
"""...and the scatter by this share of its trace."""

Numbers = tuple[float, ...]


@dataclass(frozen=True)
class ScanContent:
    """Moments of the points of a scan; no order of points changes them, and rounding hardly does."""

    points: int
    mean_m: Numbers
    """(3,) in full coordinates [m]."""
    scatter_m2: tuple[Numbers, ...]
    """(3, 3) covariance of the coordinates [m2]."""

    def to_json(self) -> dict[str, Any]:
        """Give the members as plain JSON values."""
        return {
            "points": self.points,
            "mean_m": list(self.mean_m),
            "scatter_m2": [list(row) for row in self.scatter_m2],
        }

    @staticmethod
    def from_json(stored: Mapping[str, Any]) -> "ScanContent":
        """Read what `to_json` gave."""
        return ScanContent(stored["points"], tuple(stored["mean_m"]), tuple(tuple(row) for row in stored["scatter_m2"]))


def same_content(first: ScanContent, second: ScanContent) -> bool:
    """Tell whether two scans hold the same points, but for their order and rounding.

    As many points, in the mean at the same place to a millimetre at most and scattered alike to a ten-thousandth: two
    measurements of one place do not come so near, each has its own number of returns.
    """
    if first.points != second.points:
        return False
    trace = sum(first.scatter_m2[k][k] for k in range(3))
    if math.dist(first.mean_m, second.mean_m) > min(ROUNDED_M, ROUNDED_SHARE * trace**0.5):
        return False
    rows = zip(first.scatter_m2, second.scatter_m2, strict=True)
    differences = [abs(a - b) for one, other in rows for a, b in zip(one, other, strict=True)]
    return max(differences) <= ROUNDED_SCATTER * trace
