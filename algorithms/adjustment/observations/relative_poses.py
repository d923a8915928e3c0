"""Poses of stations relative to each other as observations: the edges of a pose graph (MATH 1.4, 6.5)."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.observations.linearised import Derivative, Equations, FeatureNoise
from algorithms.adjustment.observations.relative_motion import RelativeMotions
from algorithms.adjustment.unknowns import UnknownKind, Unknowns
from algorithms.arrays import Array, Indices, Points
from algorithms.geometry.rotations import cross_matrices

SMALL_ANGLE_RAD = 1e-4
"""Below this the series of the Jacobian is exact to rounding."""


@dataclass(frozen=True, eq=False)
class RelativePoses:
    """Registrations of two stations each, target from source, with their covariances (MATH 1.4)."""

    targets: Indices
    """(n,) numbers of the targets' poses."""
    sources: Indices
    """(n,) numbers of the sources' poses."""
    observed: RigidTransform
    """(n,) target from source."""
    covariances: Float64[Array, "n 6 6"]
    """(n, 6, 6) of (rotation vector on the left in target axes [rad], translation [m])."""

    def __len__(self) -> int:
        return len(self.targets)

    def selected(self, which: Array) -> "RelativePoses":
        """Keep some of the observations, by mask or numbers."""
        return replace(
            self,
            targets=self.targets[which],
            sources=self.sources[which],
            observed=self.observed[which],
            covariances=self.covariances[which],
        )

    def noises(self) -> tuple[FeatureNoise]:
        """Say how the errors come about: each registration by itself."""
        return (FeatureNoise.independent(self.covariances),)

    def extent_m(self) -> float:
        """Give the largest coordinate that takes part [m]."""
        return float(np.abs(np.asarray(self.observed.translation)).max(initial=0.0))

    def equations(self, unknowns: Unknowns) -> Equations:
        """Compute r = (Log(R R_obsᵀ), t - t_obs) of R, t = target from source, and derivatives.

        With w_r, dt_r of the relative pose as in `RelativeMotions`: d Log(Exp(v)) = J⁻¹(v) w_r, J the left Jacobian of
        rotations (Sola et al. 2018, A micro Lie theory, eq. 146), and the observed rotation enters with its transpose.
        """
        motions = RelativeMotions.between(unknowns, self.targets, self.sources)
        turns = (Rotation.from_matrix(motions.rotations) * self.observed.rotation.inv()).as_rotvec()
        shifts = motions.translations - np.asarray(self.observed.translation)
        by_turn = inverse_left_jacobians(turns)
        nothing, unit = np.zeros_like(by_turn), np.broadcast_to(np.eye(3), by_turn.shape)
        by_target, by_source = motions.derivatives(
            np.concatenate([by_turn, nothing], axis=1), np.concatenate([nothing, unit], axis=1)
        )
        by_observed = np.zeros((len(self), 6, 6))
        by_observed[:, :3, :3] = -np.swapaxes(by_turn, 1, 2)
        by_observed[:, 3:, 3:] = -np.eye(3)
        return Equations(
            np.hstack([turns, shifts]),
            (
                Derivative(UnknownKind.POSE, self.targets, by_target),
                Derivative(UnknownKind.POSE, self.sources, by_source),
            ),
            (by_observed,),
        )


def inverse_left_jacobians(turns: Points) -> Float64[Array, "n 3 3"]:
    """Give J⁻¹ with Log(Exp(w) Exp(v)) = v + J⁻¹(v) w for small w; the transpose is for a factor on the right.

    J⁻¹(v) = I - S(v)/2 + (1/a² - (1 + cos a)/(2 a sin a)) S(v)², a = |v| (MATH 6.5; Sola et al. 2018, eq. 146).

    Parameters
    ----------
    turns
        (n, 3) rotation vectors v below a half turn [rad].
    """
    angles = np.linalg.norm(turns, axis=1)
    safe = np.where(angles > SMALL_ANGLE_RAD, angles, 1.0)
    exact = 1.0 / safe**2 - 0.5 / (safe * np.tan(0.5 * safe))
    second = np.where(angles > SMALL_ANGLE_RAD, exact, 1.0 / 12.0)
    crossed = cross_matrices(turns)
    return np.asarray(np.eye(3) - 0.5 * crossed + second[:, None, None] * (crossed @ crossed))
