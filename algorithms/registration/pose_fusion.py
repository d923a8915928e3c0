"""Join estimates of one pose, each with its covariance and with what it leaves open, and test whether they agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.rank import CentredFrame
from algorithms.arrays import Array, Matrix6
from algorithms.geometry.poses import PoseEstimate

OPEN_STD_M = 10.0
"""Motions with a larger standard deviation are open."""
LEAST_INFORMATION = 1.0 / OPEN_STD_M**2
"""The same as information [1/m²]."""


@dataclass(frozen=True, eq=False)
class Information:
    """What an estimate says of the pose, as a motion x = (radius times turn, shift of the centre) from a base pose."""

    matrix: Matrix6
    """(6, 6) inverse of the covariance of x, zero along what is open [1/m²]."""
    motion_m: Array
    """(6,) x of the estimate [m]."""


@dataclass(frozen=True)
class Consistency:
    """Test of two estimates against each other."""

    statistic: float
    """Squared difference over its covariance."""
    degrees: int
    """Motions that both determine."""
    critical: float
    """Its limit."""

    @property
    def contradicts(self) -> bool:
        """Say whether the difference is more than chance."""
        return self.statistic > self.critical

    @property
    def factor(self) -> float:
        """Factor on both covariances that explains the difference; 1 where chance does."""
        return self.statistic / self.degrees if self.contradicts else 1.0


@dataclass(frozen=True, eq=False)
class FusionFrame:
    """Where motions are told: base pose, centre and radius."""

    base: RigidTransform
    """Target from source."""
    centred: CentredFrame

    def information(self, estimate: PoseEstimate) -> Information:
        """Express an estimate near the base pose.

        C in x is regular on V, the complement of what is open: N = V (Vᵀ C V)⁻¹ Vᵀ, whatever the estimate holds what
        is open by.
        """
        back = np.linalg.inv(self.centred.to_pose(self.base))
        covariance = back @ estimate.covariance @ back.T
        free = back @ estimate.null_space
        known = np.linalg.svd(free, full_matrices=True)[0][:, free.shape[1] :] if free.size else np.eye(6)
        inner = np.linalg.inv(known.T @ covariance @ known)
        return Information(known @ (0.5 * (inner + inner.T)) @ known.T, back @ self._difference(estimate))

    def estimate(self, parts: Sequence[Information]) -> PoseEstimate:
        """Join independent estimates: x = N⁻¹ Σ N_i x_i with N = Σ N_i; what all leave open stays at the base.

        Parameters
        ----------
        parts
            At least one.
        """
        matrix = np.sum([part.matrix for part in parts], axis=0)
        values, vectors = np.linalg.eigh(matrix)
        known = values > LEAST_INFORMATION
        covariance = (vectors[:, known] / values[known]) @ vectors[:, known].T
        to_pose = self.centred.to_pose(self.base)
        moved = to_pose @ covariance @ np.sum([part.matrix @ part.motion_m for part in parts], axis=0)
        pose = RigidTransform.from_components(
            np.asarray(self.base.translation) + moved[3:], Rotation.from_rotvec(moved[:3]) * self.base.rotation
        )
        return PoseEstimate(pose, to_pose @ covariance @ to_pose.T, to_pose @ vectors[:, ~known])

    def _difference(self, estimate: PoseEstimate) -> Array:
        turn = (estimate.rotation * self.base.rotation.inv()).as_rotvec()
        return np.concatenate([turn, estimate.translation_m - np.asarray(self.base.translation)])


def consistency(first: Information, second: Information, alpha: float) -> Consistency:
    """Test whether two estimates agree where both determine the motion.

    d = x1 - x2 has the covariance C1 + C2, whose inverse is the parallel sum N1 (N1 + N2)⁺ N2 also where either is
    singular (Anderson and Duffin 1969); T = dᵀ (C1 + C2)⁻¹ d is chi-square with its rank as degrees of freedom. Errors
    that both share make T smaller, never larger.

    Parameters
    ----------
    first, second
        In the same frame.
    alpha
        Probability that good estimates fail.
    """
    parallel = parallel_sum(first.matrix, second.matrix)
    difference = first.motion_m - second.motion_m
    degrees = int(np.count_nonzero(np.linalg.eigvalsh(parallel) > LEAST_INFORMATION))
    if degrees == 0:
        return Consistency(0.0, 0, np.inf)
    return Consistency(
        max(float(difference @ parallel @ difference), 0.0), degrees, float(stats.chi2.isf(alpha, degrees))
    )


def parallel_sum(first: Matrix6, second: Matrix6) -> Matrix6:
    """Give the inverse of C1 + C2 from the inverses of C1 and C2, which may be singular."""
    together = first + second
    scale = np.sqrt(np.maximum(np.diag(together), LEAST_INFORMATION))
    inverse = np.linalg.pinv(together / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    found = first @ inverse @ second
    return np.asarray(0.5 * (found + found.T))


def share_of_first(first: Matrix6, second: Matrix6, independent: Matrix6) -> float:
    """Choose ω in N = ω N1 + (1 - ω) N2 + N3 so that the trace of the covariance is least.

    Estimates 1 and 2 rest on the same data, so that their errors are correlated nobody knows how: whatever that
    correlation is, N promises too little rather than too much (covariance intersection, Julier and Uhlmann 1997; with
    an independent part, Li and others 2013).

    Parameters
    ----------
    first, second
        (6, 6) information of two estimates from the same data.
    independent
        (6, 6) that of an estimate from other data.
    """

    def trace(share: float) -> float:
        values = np.linalg.eigvalsh(share * first + (1.0 - share) * second + independent)
        return float(np.sum(1.0 / np.maximum(values, LEAST_INFORMATION)))

    inside = float(optimize.minimize_scalar(trace, bounds=(0.0, 1.0), method="bounded").x)
    return min((1.0, 0.0, inside), key=trace)
