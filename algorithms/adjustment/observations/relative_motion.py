"""From derivatives by the relative pose of two stations to those by the poses of both, row by row (MATH 1.4)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, Indices, Matrices3, Points
from algorithms.geometry.rotations import cross_matrices


@dataclass(frozen=True, eq=False)
class RelativeMotions:
    """n relative poses T = T_t⁻¹ T_s of stations t and s (MATH 1.4)."""

    rotations: Matrices3
    """(n, 3, 3) R, target from source."""
    translations: Points
    """(n, 3) t [m]."""
    back: Matrices3
    """(n, 3, 3) R_tᵀ, target from world."""
    arms: Points
    """(n, 3) from the target's position to the source's, in the world frame [m]."""

    @staticmethod
    def between(unknowns: Unknowns, targets: Indices, sources: Indices) -> "RelativeMotions":
        """Compute the relative poses of pairs of stations (MATH 1.4).

        Parameters
        ----------
        unknowns
            Poses of all stations.
        targets, sources
            (n,) their numbers.
        """
        rotations, positions = unknowns.rotations, np.asarray(unknowns.poses.translation)
        back = np.ascontiguousarray(np.swapaxes(rotations[targets], 1, 2))
        arms = positions[sources] - positions[targets]
        return RelativeMotions(back @ rotations[sources], np.einsum("nij,nj->ni", back, arms), back, arms)

    def derivatives(
        self, by_turn: Float64[Array, "n d 3"], by_shift: Float64[Array, "n d 3"]
    ) -> tuple[Float64[Array, "n d 6"], Float64[Array, "n d 6"]]:
        """Carry derivatives by (w, dt) of the relative pose over to the poses of target and source (MATH 1.4).

        w = R_tᵀ (w_s - w_t) and dt = R_tᵀ (dt_s - dt_t + S(t_s - t_t) w_t).
        """
        turn, shift = by_turn @ self.back, by_shift @ self.back
        by_target = np.concatenate([shift @ cross_matrices(self.arms) - turn, -shift], axis=2)
        return by_target, np.concatenate([turn, shift], axis=2)
