"""What the adjustment of tied stations gives: poses, points, tests of points, of scans and of a scale (MATH 6.7)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Matrices3, Points


@dataclass(frozen=True, eq=False)
class PointTest:
    """Tests of observations of three coordinates each (MATH 4.2, 4.3)."""

    residuals: Points
    """(n, 3) adjusted minus observed, of what took no part minus predicted [m]."""
    w: Points
    """(n, 3) test values of the components; 0 where not controlled."""
    redundancy: Points
    """(n, 3)."""
    detectable_m: Points
    """(n, 3) smallest error that is found; inf where not controlled."""
    statistics: Array
    """(n,) T."""
    degrees: Array
    """(n,) its degrees of freedom."""
    p_values: Array
    """(n,)."""
    used: Flags
    """(n,)."""

    def selected(self, which: slice) -> "PointTest":
        """Keep the tests of some (MATH 4.2)."""
        return PointTest(
            *(each[which] for each in (self.residuals, self.w, self.redundancy, self.detectable_m)),
            *(each[which] for each in (self.statistics, self.degrees, self.p_values, self.used)),
        )


@dataclass(frozen=True)
class ScaleTest:
    """Whether lengths in the control differ from those in the scans (MATH 6.7)."""

    scale: float
    """Length in the control over that in the scans, less one."""
    std: float
    """Its standard deviation."""
    p_value: float
    """Probability of a larger one by chance."""
    significant: bool


@dataclass(frozen=True)
class ScansTest:
    """Whether targets and control contradict what scans say of a group of stations (MATH 4.2)."""

    statistic: float
    """T of all their poses together."""
    degrees: int
    """Its degrees of freedom."""
    p_value: float
    """Probability of a larger one by chance."""
    agrees: bool
    """False where that is the least probable of all possible errors: the scans' poses were left out, as far as the
    points hold the stations without them."""


@dataclass(frozen=True, eq=False)
class TiedAdjustment:
    """Adjusted stations and points (MATH 6.7)."""

    poses: tuple[RigidTransform, ...]
    """World from station."""
    covariance: Array
    """(6 p, 6 p) of all poses: rotation vector on the left, translation; a priori sigma0."""
    points: Points
    """(n, 3) in the world [m]."""
    point_covariances: Matrices3
    """(n, 3, 3) [m²]."""
    seen: PointTest
    control: PointTest
    scans: tuple[ScansTest, ...]
    """Of each group of stations that scans registered."""
    scale: ScaleTest | None
    """None: too little control."""
    omega: float
    redundancy: int
    converged: bool

    @property
    def sigma0(self) -> float | None:
        """Standard deviation of unit weight a posteriori; None without redundancy (MATH 4.1)."""
        return float(np.sqrt(self.omega / self.redundancy)) if self.redundancy > 0 else None

    def pose_covariance(self, station: int) -> Array:
        """Give (6, 6) of one station (MATH 1.4)."""
        return self.covariance[6 * station : 6 * station + 6, 6 * station : 6 * station + 6]
