"""What a scanner measures of a point: horizontal angle, zenith angle, slope distance (MATH 6.1; Haring 2003, ch. 4)."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Int32

from algorithms.adjustment.observations.linearised import Derivative, Equations, FeatureNoise
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array, Indices, Scalars
from algorithms.geometry.rotations import cross_matrices


class PolarComponent(IntEnum):
    """Which of the three a number is."""

    HORIZONTAL = 0
    """Angle from x towards y, mathematically positive [rad]."""
    ZENITH = 1
    """Angle from z [rad]."""
    DISTANCE = 2
    """Slope distance [m]."""


@dataclass(frozen=True, eq=False)
class Polar:
    """Single polar observations of object points (MATH 6.1); what was not measured is simply not among them."""

    stations: Indices
    """(n,) numbers of the poses, world from station."""
    points: Indices
    """(n,) numbers of the object points."""
    components: Int32[Array, "n"]
    """(n,) `PolarComponent`."""
    values: Scalars
    """(n,) observed [rad] or [m]."""
    stds: Scalars
    """(n,) their standard deviations [rad] or [m]."""

    def __len__(self) -> int:
        return len(self.values)

    def selected(self, which: Array) -> "Polar":
        """Keep some of the observations, by mask or numbers."""
        return replace(
            self,
            stations=self.stations[which],
            points=self.points[which],
            components=self.components[which],
            values=self.values[which],
            stds=self.stds[which],
        )

    def noises(self) -> tuple[FeatureNoise]:
        """Say how the errors come about: each observation by itself."""
        return (FeatureNoise.independent(np.square(self.stds)[:, None, None]),)

    def extent_m(self) -> float:
        """Give the largest distance [m]."""
        return float(self.values[self.components == PolarComponent.DISTANCE].max(initial=0.0))

    def equations(self, unknowns: Unknowns) -> Equations:
        """Compute computed minus observed values and their derivatives at x = Rᵀ (X - X0).

        dx = Rᵀ (dX - dX0 + S(X - X0) w); differences of horizontal angles are wrapped to a half turn.
        """
        rotations = unknowns.rotations[self.stations]
        arms = unknowns.points[self.points] - np.asarray(unknowns.poses.translation)[self.stations]
        back = np.swapaxes(rotations, 1, 2)
        x, y, z = np.einsum("nij,nj->in", back, arms)
        flat_squared = np.maximum(x * x + y * y, np.finfo(np.float64).tiny)
        flat = np.sqrt(flat_squared)
        distance = np.hypot(flat, z)
        computed = np.stack([np.arctan2(y, x), np.arctan2(flat, z), distance])
        rows = np.zeros((3, len(self), 3))
        rows[0] = np.stack([-y, x, np.zeros_like(x)], axis=1) / flat_squared[:, None]
        rows[1] = np.stack([x * z, y * z, -flat_squared], axis=1) / (flat * distance**2)[:, None]
        rows[2] = np.stack([x, y, z], axis=1) / distance[:, None]
        take = (self.components, np.arange(len(self)))
        residuals = computed[take] - self.values
        angular = self.components == PolarComponent.HORIZONTAL
        residuals[angular] = (residuals[angular] + np.pi) % (2.0 * np.pi) - np.pi
        by_point = np.einsum("ni,nij->nj", rows[take], back)[:, None, :]
        by_pose = np.concatenate([by_point @ cross_matrices(arms), -by_point], axis=2)
        return Equations(
            residuals[:, None],
            (
                Derivative(UnknownKind.POSE, self.stations, by_pose),
                Derivative(UnknownKind.POINT, self.points, by_point),
            ),
            (np.full((len(self), 1, 1), -1.0),),
        )
