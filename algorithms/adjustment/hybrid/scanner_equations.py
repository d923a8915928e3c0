"""What instruments on stations observe: polar elements, points in their frame, tilts (MATH 6.1, 6.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.hybrid.observations import Block, Observations, Stacked
from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array, Indices
from algorithms.geometry.rotations import cross_matrices

HORIZONTAL, ZENITH, DISTANCE = 0, 1, 2
HALF_TURN = np.pi
LEAST_ARM_M = 1e-9
"""Points nearer to the vertical axis of a station have no direction; their derivatives stay finite."""


def wrapped(angles: Array) -> Array:
    """Bring angles [rad] into (-π, π] (MATH 6.1)."""
    return np.asarray(HALF_TURN - (HALF_TURN - angles) % (2.0 * HALF_TURN))


@dataclass(frozen=True, eq=False)
class PolarObservations(Observations):
    """Single polar elements of points (MATH 6.1), with the instrument errors of their scanner."""

    stations: Indices
    """(n,)."""
    points: Indices
    """(n,)."""
    components: Indices
    """(n,) `HORIZONTAL`, `ZENITH` [rad] or `DISTANCE` [m]."""
    values: Array
    """(n,) observed."""
    scanners: Indices
    """(n,) numbers of the sets of instrument errors, 0 for none."""
    heights: Array
    """(n,) of the target above its point [m]."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.POSE, self.stations), (Kind.POINT, self.points), (Kind.SCANNER, self.scanners))

    def in_station(self, state: State) -> Array:
        """Give the targets in the frames of their stations, (n, 3) (MATH 6.1)."""
        arms = state.points[self.points] - state.positions[self.stations]
        arms[:, 2] += self.heights
        return np.asarray(np.einsum("nji,nj->ni", state.rotations[self.stations], arms))

    def stacked(self, state: State) -> Stacked:
        """Compute a = atan2(y, x) + c/sin z + i/tan z, z = atan2(hypot(x, y), z) + index, s = |x| + offset (MATH 6.1).

        dx = Rᵀ (dX - dt) + S(x) w, w the rotation vector in the station's axes.
        """
        n = np.arange(len(self))
        local = self.in_station(state)
        x, y, z = local.T
        flat_squared = np.maximum(x * x + y * y, LEAST_ARM_M**2)
        flat = np.sqrt(flat_squared)
        distance = np.hypot(flat, z)
        errors = state.scanners[self.scanners]
        sine, cotangent = flat / distance, z / flat
        values = np.stack([
            np.arctan2(y, x) + errors[:, 1] / sine + errors[:, 2] * cotangent,
            np.arctan2(flat, z) + errors[:, 3],
            distance + errors[:, 0],
        ])  # fmt: skip
        rows = np.zeros((3, len(self), 3))
        rows[HORIZONTAL] = np.stack([-y, x, np.zeros_like(x)], axis=1) / flat_squared[:, None]
        rows[ZENITH] = np.stack([x * z, y * z, -flat_squared], axis=1) / (flat * distance**2)[:, None]
        rows[DISTANCE] = np.stack([x, y, z], axis=1) / distance[:, None]
        # d(1/sin z) = -cos z / sin² z dz, d(cot z) = -1 / sin² z dz
        rows[HORIZONTAL] -= ((errors[:, 1] * z / distance + errors[:, 2]) / sine**2)[:, None] * rows[ZENITH]
        by_errors = np.zeros((3, len(self), 4))
        by_errors[HORIZONTAL, :, 1], by_errors[HORIZONTAL, :, 2] = 1.0 / sine, cotangent
        by_errors[ZENITH, :, 3] = by_errors[DISTANCE, :, 0] = 1.0
        residuals = values[self.components, n] - self.values
        turning = self.components != DISTANCE
        residuals[turning] = wrapped(residuals[turning])
        row = rows[self.components, n]
        by_point = np.einsum("ni,nji->nj", row, state.rotations[self.stations])[:, None, :]
        by_turn = np.einsum("ni,nij->nj", row, cross_matrices(local))[:, None, :]
        return Stacked(
            residuals[:, None],
            (
                Block(Kind.POSE, self.stations, np.concatenate([by_turn, -by_point], axis=2)),
                Block(Kind.POINT, self.points, by_point),
                Block(Kind.SCANNER, self.scanners, by_errors[self.components, n][:, None, :]),
            ),
        )

    def metres(self, state: State) -> Array:
        """Give the distance for angles, and 1 for distances (MATH 6.1)."""
        local = self.in_station(state)
        flat, distance = np.hypot(local[:, 0], local[:, 1]), np.linalg.norm(local, axis=1)
        return np.stack([flat, distance, np.ones_like(flat)])[self.components, np.arange(len(self)), None]


@dataclass(frozen=True, eq=False)
class StationCoordinates(Observations):
    """Points in the frame of a station, as tie points with covariance are: Rᵀ (X - t) (MATH 6.1)."""

    stations: Indices
    """(n,)."""
    points: Indices
    """(n,)."""
    values: Array
    """(n, 3) observed [m]."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.POSE, self.stations), (Kind.POINT, self.points))

    def stacked(self, state: State) -> Stacked:
        """Compute Rᵀ (X - t) minus what was observed (MATH 6.1)."""
        back = np.swapaxes(state.rotations[self.stations], 1, 2)
        local = np.einsum("nij,nj->ni", back, state.points[self.points] - state.positions[self.stations])
        by_pose = np.concatenate([cross_matrices(local), -back], axis=2)
        return Stacked(
            local - self.values, (Block(Kind.POSE, self.stations, by_pose), Block(Kind.POINT, self.points, back))
        )


@dataclass(frozen=True, eq=False)
class Tilts(Observations):
    """Inclinometer: ω and φ of levelled stations (MATH 6.3); single components."""

    stations: Indices
    """(n,)."""
    components: Indices
    """(n,) 0: ω = atan2(-r23, r33), 1: φ = atan2(r13, hypot(r11, r12))."""
    values: Array
    """(n,) observed [rad]."""

    @property
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give the unknowns that take part (MATH 6.1)."""
        return ((Kind.POSE, self.stations),)

    def stacked(self, state: State) -> Stacked:
        """Compute ω and φ, whose derivatives are rows of W⁻¹ R (MATH 1.3, 6.1)."""
        rotations = state.rotations[self.stations]
        angles, rates = opk_and_rates(rotations)
        n = np.arange(len(self))
        jacobian = np.zeros((len(self), 1, 6))
        jacobian[:, 0, :3] = rates[n, self.components]
        residuals = wrapped(angles[n, self.components] - self.values)
        return Stacked(residuals[:, None], (Block(Kind.POSE, self.stations, jacobian),))


def opk_and_rates(rotations: Array) -> tuple[Array, Array]:
    """Give ω, φ, κ (n, 3) of R = Rx(ω) Ry(φ) Rz(κ) and their derivatives (n, 3, 3) by w in R Exp(w) (MATH 1.2, 1.3)."""
    r = rotations
    flat = np.hypot(r[:, 0, 0], r[:, 0, 1])
    omega, phi = np.arctan2(-r[:, 1, 2], r[:, 2, 2]), np.arctan2(r[:, 0, 2], flat)
    kappa = np.arctan2(-r[:, 0, 1], r[:, 0, 0])
    so, co, sp, cp = np.sin(omega), np.cos(omega), np.sin(phi), np.maximum(np.cos(phi), 1e-12)
    inverse = np.zeros((len(r), 3, 3))  # W⁻¹
    inverse[:, 0, 0] = 1.0
    inverse[:, 0, 1], inverse[:, 0, 2] = so * sp / cp, -co * sp / cp
    inverse[:, 1, 1], inverse[:, 1, 2] = co, so
    inverse[:, 2, 1], inverse[:, 2, 2] = -so / cp, co / cp
    return np.stack([omega, phi, kappa], axis=1), inverse @ r


def azk_and_rates(rotations: Array) -> tuple[Array, Array]:
    """Give α, ζ, κ (n, 3) of R = Rz(α) Ry(ζ) Rz(κ) and their derivatives by w in R Exp(w) (MATH 1.3); ζ in [0, π]."""
    r = rotations
    sine = np.hypot(r[:, 0, 2], r[:, 1, 2])
    alpha, zeta = np.arctan2(r[:, 1, 2], r[:, 0, 2]), np.arctan2(sine, r[:, 2, 2])
    kappa = np.arctan2(r[:, 2, 1], -r[:, 2, 0])
    sa, ca, sz, cz = np.sin(alpha), np.cos(alpha), np.maximum(np.sin(zeta), 1e-12), np.cos(zeta)
    inverse = np.zeros((len(r), 3, 3))
    inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 0, 2] = -ca * cz / sz, -sa * cz / sz, 1.0
    inverse[:, 1, 0], inverse[:, 1, 1] = -sa, ca
    inverse[:, 2, 0], inverse[:, 2, 1] = ca / sz, sa / sz
    return np.stack([alpha, zeta, kappa], axis=1), inverse @ r
