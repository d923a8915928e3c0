"""Corrections of a strip by polynomials and waves in time, and their derivatives (MATH 12.1)."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.strips.options import CorrectionOptions
from algorithms.strips.strip import StripPath
from algorithms.strips.waves import Knots

SHIFTS, TILTS = ("shift_x", "shift_y", "shift_z"), ("roll", "pitch", "heading")
BORESIGHT = ("boresight_roll", "boresight_pitch", "boresight_heading")
MOUNT = ("shift_forward", "shift_left", "common_roll", "common_pitch", "common_heading")
"""Corrections that strips without trajectories have in common, in the axes of each strip."""
AT_ONCE = 1 << 18
"""Points that are corrected in one go."""


@dataclass(frozen=True)
class Degrees:
    """Highest powers of time."""

    shift: int
    tilt: int
    """-1: strips are not turned."""

    @staticmethod
    def of(options: CorrectionOptions) -> "Degrees":
        """Take those of a request."""
        return Degrees(options.shift_degree, options.tilt_degree)

    @property
    def count(self) -> int:
        """Coefficients of a strip."""
        return 3 * (self.shift + 1) + 3 * (self.tilt + 1)

    def names(self) -> list[tuple[str, int]]:
        """Give parameter and power of every coefficient, in their order: all shifts by powers, then all tilts."""
        return [(name, power) for power in range(self.shift + 1) for name in SHIFTS] + [
            (name, power) for power in range(self.tilt + 1) for name in TILTS
        ]

    def split(self, coefficients: Float64[Array, "c"]) -> tuple[Array, Array]:
        """Give coefficients of the shifts (shift + 1, 3) [m] and of the tilts (tilt + 1, 3) [rad]."""
        cut = 3 * (self.shift + 1)
        return coefficients[:cut].reshape(-1, 3), coefficients[cut:].reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Correction:
    """What corrects one strip."""

    path: StripPath
    degrees: Degrees
    coefficients: Float64[Array, "c"]
    """(c,) in the order of `Degrees.names` [m, rad]; time runs from -1 to 1."""
    boresight_rad: Vector3
    """(3,) about the body's axes forward, left, up [rad]."""
    mount: Float64[Array, "5"] = field(default_factory=lambda: np.zeros(len(MOUNT)))
    """(5,) in the order of `MOUNT`, of a strip without trajectory [m, rad]."""
    knots: Knots | None = None
    waves: Float64[Array, "knots 6"] | None = None
    """(knots, 6) shifts along x, y, z and roll, pitch, heading at the knots [m, rad]; None: no waves."""

    def applied(self, points: Points, times_s: Scalars) -> Points:
        """Give corrected points (n, 3): x' = c + s + Exp(θ) Exp(R β) (x − c) (MATH 12.1).

        c is the scanner's place, or without a trajectory the middle line on the ground; s and θ are polynomials and
        waves in time, θ in the axes of the strip; R β is the bore-sight in world axes. Without a trajectory the mount
        adds to s and θ what all strips have in common.
        """
        out = np.empty_like(points)
        for start in range(0, len(points), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            centres, shift, arms, _, _ = self._parts(points[part], times_s[part])
            out[part] = centres + shift + arms
        return out

    def derivatives(self, points: Points, times_s: Scalars, along: Points) -> tuple[Array, Array]:
        """Give how points move along directions (n, 3) with the coefficients (n, c) and the bore-sight (n, 3).

        n·(δθ × a) = (a × n)·δθ with the turned arm a, and δθ = J dθ with the left Jacobian of the rotation.
        """
        fields, turns = self.fields(points, times_s, along)
        return self.by_coefficients(fields, times_s), turns

    def fields(self, points: Points, times_s: Scalars, along: Points) -> tuple[Array, Array]:
        """Return how points move along directions (n, 3) with shift and tilt at their times (n, 6), and turns (n, 3).

        The turns are those of the bore-sight, zero without a trajectory.
        """
        _, _, arms, tilt, turn = self._parts(points, times_s)
        by_tilt = _times_left_jacobian(np.cross(arms, along), tilt) @ self.path.axes
        fields = np.hstack([along, by_tilt])
        if self.path.bodies is None:
            return fields, np.zeros((len(points), 3))
        back = Rotation.from_rotvec(tilt).inv()
        by_turn = _times_left_jacobian(np.cross(back.apply(arms), back.apply(along)), turn)
        return fields, np.einsum("ni,nij->nj", by_turn, self.path.bodies_at(times_s))

    def by_coefficients(self, fields: Array, times_s: Scalars) -> Array:
        """Return derivatives (n, c) by the coefficients from those by shift and tilt (n, 6)."""
        tau = self.path.relative(times_s)
        blocks = [fields[:, :3] * (tau**k)[:, None] for k in range(self.degrees.shift + 1)]
        blocks += [fields[:, 3:] * (tau**k)[:, None] for k in range(self.degrees.tilt + 1)]
        return np.concatenate(blocks, axis=1)

    def by_mount(self, fields: Array) -> Array:
        """Return derivatives (n, 5) by the mount, zero with a trajectory."""
        if self.path.bodies is not None:
            return np.zeros((len(fields), len(MOUNT)))
        return np.hstack([fields[:, :3] @ self.path.axes[:, :2], fields[:, 3:]])

    def _parts(self, points: Points, times_s: Scalars) -> tuple[Points, Points, Points, Points, Points]:
        """Give centres, shifts, turned arms, tilts and bore-sight turns."""
        tau = self.path.relative(times_s)
        shifts, tilts = self.degrees.split(self.coefficients)
        centres = self.path.centres(times_s)
        arms = points - centres
        turn = self.path.turned(self.boresight_rad, times_s)
        if self.boresight_rad.any():
            arms = Rotation.from_rotvec(turn).apply(arms)
        shift, tilt = _polynomials(tau, shifts), _polynomials(tau, tilts)
        if self.knots is not None and self.waves is not None:
            waves = self.knots.interpolated(self.waves, times_s)
            shift, tilt = shift + waves[:, :3], tilt + waves[:, 3:]
        if self.path.bodies is None:
            shift, tilt = shift + self.path.axes[:, :2] @ self.mount[:2], tilt + self.mount[2:]
        tilt = tilt @ self.path.axes.T
        if tilt.any():
            arms = Rotation.from_rotvec(tilt).apply(arms)
        return centres, shift, arms, tilt, turn


def _polynomials(tau: Scalars, coefficients: Array) -> Points:
    """Evaluate three polynomials (powers, 3) at times (n,)."""
    if len(coefficients) == 0:
        return np.zeros((len(tau), 3))
    return np.asarray(np.vander(tau, len(coefficients), increasing=True) @ coefficients)


def _times_left_jacobian(rows: Points, vectors: Points) -> Points:
    """Give rowᵀ J (n, 3), with J of Exp(θ + dθ) = Exp(J dθ) Exp(θ), to the third order of the small θ (n, 3)."""
    first = np.cross(rows, vectors)
    second = np.cross(first, vectors)
    return np.asarray(rows + 0.5 * first + second / 6.0 + np.cross(second, vectors) / 24.0)
