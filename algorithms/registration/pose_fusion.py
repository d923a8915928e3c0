"""Join estimates of one pose, each with its covariance and with what it leaves open, and test whether they agree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.rank import CentredFrame
from algorithms.arrays import Array, Matrix6
from algorithms.geometry.poses import PoseEstimate
from algorithms.probabilities import chi2_isf

OPEN_STD_M = 10.0
"""Motions with a larger standard deviation are open."""
LEAST_INFORMATION = 1.0 / OPEN_STD_M**2
"""The same as information [1/m²]."""


SAME_MOTION = 0.05
"""Two estimates leave the same motion open when theirs are within this angle [rad]: each knows it as well as it knows
the directions of its lines or normals, and between the two the motion must not pass for determined (MATH 5.2)."""


@dataclass(frozen=True, eq=False)
class Information:
    """What an estimate says of the pose, as a motion x = (radius times turn, shift of the centre) from a base pose."""

    covariance: Matrix6
    """(6, 6) covariance of x, zero along what is open [m²]."""
    free: Array
    """(6, k) orthonormal motions that are open."""
    motion_m: Array
    """(6,) x of the estimate [m]."""

    @cached_property
    def matrix(self) -> Matrix6:
        """(6, 6) information: inverse of the covariance on what is determined, zero along the rest [1/m²]."""
        known = _complement(self.free)
        inner = np.linalg.inv(known.T @ self.covariance @ known)
        return np.asarray(known @ (0.5 * (inner + inner.T)) @ known.T)

    def with_covariance_scaled(self, factor: float) -> "Information":
        """Give the same with a covariance that is larger by a factor."""
        return Information(self.covariance * factor, self.free, self.motion_m)

    @staticmethod
    def nothing() -> "Information":
        """Know nothing."""
        return Information(np.zeros((6, 6)), np.eye(6), np.zeros(6))


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
        """Express an estimate near the base pose; how it holds what it leaves open does not matter."""
        back = np.linalg.inv(self.centred.to_pose(self.base))
        known = _complement(back @ estimate.null_space)
        inner = known.T @ back @ estimate.covariance @ back.T @ known
        return Information(known @ inner @ known.T, _complement(known), back @ self._difference(estimate))

    def estimate(self, parts: Sequence[tuple[float, Information]]) -> PoseEstimate:
        """Join independent estimates: x = N⁻¹ Σ N_i x_i with N = Σ N_i; what all leave open stays at the base.

        Parameters
        ----------
        parts
            Factor on the information, and the estimate; at least one.
        """
        known, inverse = _joined([(share * part.matrix, part.free) for share, part in parts])
        covariance = known @ inverse @ known.T
        right = np.sum([share * part.matrix @ part.motion_m for share, part in parts], axis=0)
        to_pose = self.centred.to_pose(self.base)
        moved = to_pose @ covariance @ right
        pose = RigidTransform.from_components(
            np.asarray(self.base.translation) + moved[3:], Rotation.from_rotvec(moved[:3]) * self.base.rotation
        )
        return PoseEstimate(pose, to_pose @ covariance @ to_pose.T, to_pose @ _complement(known))

    def holding_both(self, estimate: PoseEstimate, first: Information, second: Information) -> PoseEstimate:
        """Widen the covariance so that it holds two estimates that contradict each other, each as likely right.

        C + ½ Σ (xᵢ - x)(xᵢ - x)ᵀ, the second moment about x of an even mixture, on the motions that both determine.

        Parameters
        ----------
        estimate
            x, joined from both.
        first, second
            They.
        """
        determined = _determined_by_both(first, second)
        x = self.information(estimate).motion_m
        away = np.stack([first.motion_m - x, second.motion_m - x], axis=1)
        moved = self.centred.to_pose(self.base) @ determined @ (determined.T @ away)
        return replace(estimate, covariance=estimate.covariance + 0.5 * moved @ moved.T)

    def _difference(self, estimate: PoseEstimate) -> Array:
        turn = (estimate.rotation * self.base.rotation.inv()).as_rotvec()
        return np.concatenate([turn, estimate.translation_m - np.asarray(self.base.translation)])


def joint_covariance(parts: Sequence[tuple[float, Information]]) -> Matrix6:
    """Give the covariance (6, 6) of x of joined estimates, zero along what all leave open [m²]."""
    known, inverse = _joined([(share * part.matrix, part.free) for share, part in parts])
    return np.asarray(known @ inverse @ known.T)


def consistency(first: Information, second: Information, alpha: float) -> Consistency:
    """Test whether two estimates agree where both determine the motion.

    d = x1 - x2 has the covariance C1 + C2, and T = dᵀ (C1 + C2)⁻¹ d on the motions V that neither leaves open is
    chi-square with as many degrees of freedom. Errors that both share make T smaller, never larger.

    Parameters
    ----------
    first, second
        In the same frame.
    alpha
        Probability that good estimates fail.
    """
    determined = _determined_by_both(first, second)
    degrees = determined.shape[1]
    if degrees == 0:
        return Consistency(0.0, 0, np.inf)
    difference = first.motion_m - second.motion_m
    statistic = float(difference @ information_of_difference(first, second) @ difference)
    return Consistency(max(statistic, 0.0), degrees, float(chi2_isf(alpha, degrees)))


def information_of_difference(first: Information, second: Information) -> Matrix6:
    """Give V (Vᵀ (C1 + C2) V)⁻¹ Vᵀ of the difference of two estimates, V the motions that neither leaves open."""
    determined = _determined_by_both(first, second)
    if determined.shape[1] == 0:
        return np.zeros((6, 6))
    inner = np.linalg.inv(determined.T @ (first.covariance + second.covariance) @ determined)
    return np.asarray(determined @ (0.5 * (inner + inner.T)) @ determined.T)


def _determined_by_both(first: Information, second: Information) -> Array:
    return _complement(np.hstack([first.free, second.free]), SAME_MOTION)


def _complement(motions: Array, least: float = 1e-9) -> Array:
    """Give an orthonormal basis of what is orthogonal to all columns, those with singular values below a share left."""
    if motions.shape[1] == 0:
        return np.eye(6)
    left, singular, _ = np.linalg.svd(motions, full_matrices=True)
    return np.asarray(left[:, int(np.count_nonzero(singular > least * singular[0])) :])


def _joined(parts: Sequence[tuple[Matrix6, Array]]) -> tuple[Array, Array]:
    """Give the motions (6, k) that information matrices determine together, and the covariance (k, k) along them.

    A motion that every estimate which speaks of it leaves open, but for an angle of `SAME_MOTION`, is open.
    """
    matrix = np.sum([own for own, _ in parts], axis=0)
    values, vectors = np.linalg.eigh(matrix)
    known = values > LEAST_INFORMATION
    for k in np.flatnonzero(known).tolist():
        motion = vectors[:, k]
        speaking = [free for own, free in parts if motion @ own @ motion > 0.01 * values[k]]
        known[k] = any(np.linalg.norm(motion - free @ (free.T @ motion)) > SAME_MOTION for free in speaking)
    basis = vectors[:, known]
    inverse = np.linalg.inv(basis.T @ matrix @ basis) if known.any() else np.empty((0, 0))
    return basis, inverse


def share_of_first(first: Matrix6, second: Matrix6) -> float:
    """Choose ω in N = ω N1 + (1 - ω) N2 so that the trace of the covariance is least.

    Estimates 1 and 2 rest on the same data, so that their errors are correlated nobody knows how: whatever that
    correlation is, N promises too little rather than too much (covariance intersection, Julier and Uhlmann 1997).

    Parameters
    ----------
    first, second
        (6, 6) information of two estimates from the same data.
    """

    def trace(share: float) -> float:
        values = np.linalg.eigvalsh(share * first + (1.0 - share) * second)
        return float(np.sum(1.0 / np.maximum(values, LEAST_INFORMATION)))

    inside = float(optimize.minimize_scalar(trace, bounds=(0.0, 1.0), method="bounded").x)
    return min((1.0, 0.0, inside), key=trace)
