"""What a strip and a trajectory are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int8

from algorithms.arrays import Array, Matrices3, Matrix3, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError

LEAST_POINTS = 100
"""A strip of fewer is none."""
EDGE = 0.95
"""Share of the points that lie nearer to the middle line than its edge."""
LONGEST_GAP_S = 5.0
"""Between two places of a trajectory; what lies further from both is not known [s]."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where the scanner was, and how it was turned."""

    times_s: Scalars
    """(k,) ascending, as those of the points, minus the same origin [s]."""
    positions_m: Points
    """(k, 3) in the reduced common frame [m]."""
    angles_rad: Points | None = None
    """(k, 3) roll (right wing down), pitch (nose up), heading (from north, +y, clockwise) [rad]; None: unknown, then
    the flight direction gives the heading, and roll and pitch are taken for zero."""

    def __post_init__(self) -> None:
        """See that times ascend.

        Raises
        ------
        InvalidInputError
            Fewer than two places, or times that do not ascend.
        """
        if len(self.times_s) < 2:
            raise InvalidInputError("trajectory", "it has fewer than two places", "give the whole flight")
        if (np.diff(self.times_s) <= 0.0).any():
            at = int(np.flatnonzero(np.diff(self.times_s) <= 0.0)[0]) + 2
            raise InvalidInputError("trajectory", f"the time of place {at} is not later than that before it")

    def covers(self, first_s: float, last_s: float) -> bool:
        """Tell whether it knows all places between two times."""
        slack = float(np.median(np.diff(self.times_s)))
        if first_s < self.times_s[0] - slack or last_s > self.times_s[-1] + slack:
            return False
        inside = (self.times_s[1:] > first_s) & (self.times_s[:-1] < last_s)
        return bool((np.diff(self.times_s)[inside] <= LONGEST_GAP_S).all())

    def positions(self, times_s: Scalars) -> Points:
        """Interpolate positions (n, 3) [m]."""
        return np.column_stack([np.interp(times_s, self.times_s, self.positions_m[:, k]) for k in range(3)])

    @cached_property
    def bodies(self) -> Matrices3:
        """World from body (k, 3, 3), the body's axes forward, left, up."""
        if self.angles_rad is None:
            forward = np.gradient(self.positions_m, self.times_s, axis=0)
            roll, pitch = np.zeros((2, len(forward)))
            heading = np.arctan2(forward[:, 0], forward[:, 1])
        else:
            roll, pitch, heading = self.angles_rad.T
        azimuth = 0.5 * np.pi - heading
        ca, sa, cp, sp, cr, sr = (f(x) for x in (azimuth, pitch, roll) for f in (np.cos, np.sin))
        # Rz(azimuth) Ry(-pitch) Rx(roll)
        return np.stack(
            [
                np.column_stack([ca * cp, -ca * sp * sr - sa * cr, -ca * sp * cr + sa * sr]),
                np.column_stack([sa * cp, -sa * sp * sr + ca * cr, -sa * sp * cr - ca * sr]),
                np.column_stack([sp, cp * sr, cp * cr]),
            ],
            axis=1,
        )


@dataclass(frozen=True, eq=False)
class Strip:
    """Points of one flight line in the order of their times."""

    name: str
    points: Points
    """(n, 3) in the reduced common frame, z upwards [m]."""
    times_s: Scalars
    """(n,) ascending, minus the common origin [s]."""
    trajectory: Trajectory | None = None
    directions: Int8[Array, "n"] | None = None
    """(n,) 1 and 0 for both directions of an oscillating mirror; None: unknown or only one."""

    def __post_init__(self) -> None:
        """See that it is a strip.

        Raises
        ------
        InvalidInputError
            Too few points, times that do not ascend or are all the same, or a trajectory of another time.
        """
        if len(self.points) < LEAST_POINTS:
            raise InvalidInputError(
                f"strip {self.name}", f"it has {len(self.points)} points", f"strips have at least {LEAST_POINTS}"
            )
        if (np.diff(self.times_s) < 0.0).any():
            raise InvalidInputError(f"strip {self.name}", "its points are not in the order of their times")
        if self.times_s[-1] - self.times_s[0] <= 0.0:
            raise InvalidInputError(
                f"strip {self.name}", "all its points have one time", "give files with the GPS time of every point"
            )
        if self.trajectory is not None and not self.trajectory.covers(self.times_s[0], self.times_s[-1]):
            raise InvalidInputError(
                f"strip {self.name}",
                "the trajectory does not cover its times without gaps",
                "see that both count the same GPS time, and give the trajectory of its flight",
            )

    @cached_property
    def path(self) -> "StripPath":
        """Where it was measured from."""
        first, last = float(self.times_s[0]), float(self.times_s[-1])
        if self.trajectory is not None:
            part = (self.trajectory.times_s >= first) & (self.trajectory.times_s <= last)
            inner = self.trajectory.times_s[part]
            nodes = np.concatenate([[first], inner[(inner > first) & (inner < last)], [last]])
            bodies = np.empty((len(nodes), 3, 3))
            for i in range(3):
                for j in range(3):
                    bodies[:, i, j] = np.interp(nodes, self.trajectory.times_s, self.trajectory.bodies[:, i, j])
            return StripPath(first, last, nodes, self.trajectory.positions(nodes), bodies, 0.0)
        nodes = np.linspace(first, last, 65)
        powers = np.vander(_relative(self.times_s, first, last), 3, increasing=True)
        line = np.linalg.solve(powers.T @ powers, powers.T @ self.points)
        middle = np.vander(_relative(nodes, first, last), 3, increasing=True) @ line
        apart = np.linalg.norm((self.points - powers @ line)[:, :2], axis=1)
        return StripPath(first, last, nodes, middle, None, float(np.quantile(apart, EDGE)))


@dataclass(frozen=True, eq=False)
class StripPath:
    """The line about whose places a strip is turned: the trajectory, or without one the middle line on the ground."""

    first_s: float
    last_s: float
    nodes_s: Scalars
    """(k,) from the first to the last time [s]."""
    centres_m: Points
    """(k, 3) [m]."""
    bodies: Matrices3 | None
    """(k, 3, 3) world from body; None without a trajectory."""
    reach_m: float = 0.0
    """Distance from the middle line to the edge of the strip; 0 with a trajectory [m]."""

    def relative(self, times_s: Scalars) -> Scalars:
        """Give times (n,) from -1 at the beginning to 1 at the end."""
        return _relative(times_s, self.first_s, self.last_s)

    def centres(self, times_s: Scalars) -> Points:
        """Interpolate the places (n, 3) about which points are turned [m]."""
        return np.column_stack([np.interp(times_s, self.nodes_s, self.centres_m[:, k]) for k in range(3)])

    def bodies_at(self, times_s: Scalars) -> Matrices3:
        """Interpolate world from body (n, 3, 3); zero without a trajectory."""
        out = np.zeros((len(times_s), 3, 3))
        if self.bodies is not None:
            for i in range(3):
                for j in range(3):
                    out[:, i, j] = np.interp(times_s, self.nodes_s, self.bodies[:, i, j])
        return out

    def turned(self, boresight_rad: Vector3, times_s: Scalars) -> Points:
        """Give rotation vectors (n, 3) in world axes of a turn in body axes [rad]."""
        if self.bodies is None:
            return np.zeros((len(times_s), 3))
        nodes = self.bodies @ boresight_rad
        return np.column_stack([np.interp(times_s, self.nodes_s, nodes[:, k]) for k in range(3)])

    @cached_property
    def axes(self) -> Matrix3:
        """Columns forward, left, up of the whole strip, level: what roll, pitch and heading turn about."""
        along = self.centres_m[-1, :2] - self.centres_m[0, :2]
        x, y = along / max(float(np.hypot(*along)), 1e-9) if np.hypot(*along) > 1e-9 else np.array([1.0, 0.0])
        return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def _relative(times_s: Scalars, first_s: float, last_s: float) -> Scalars:
    return np.asarray((times_s - 0.5 * (first_s + last_s)) / (0.5 * (last_s - first_s)))
