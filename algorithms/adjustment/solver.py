"""Least squares for one pose: Gauss-Newton on the group of rigid motions (MATH 1.4, 3.1)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from algorithms.adjustment.problem import LinearSystem, Problem
from algorithms.adjustment.weights import Whitening, whitening_of
from algorithms.arrays import Array, Matrix6

STEP_IN_STD = 1e-8
"""A step below this share of the standard deviations changes nothing that anyone could see."""

STEP_ROUNDING = 1e-14
"""A step below this share of the problem's size is rounding."""

SAME_WEIGHTS_STEP = 1e-5
"""Joint weights (costly) are computed anew only after the pose has moved by more than this share of the size: below,
they change by about as little, and the pose by that share of its standard deviation."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The least squares pose of a problem and everything testing needs."""

    pose: RigidTransform
    """Target from source, in the problem's own (reduced) frames."""
    cofactors: Matrix6
    """(6, 6) Q, the covariance of the pose for sigma0 = 1; for the held conditions b, Q b = 0."""
    normal_matrix: Matrix6
    """(6, 6) N = Jᵀ P J."""
    system: LinearSystem
    """Residuals, derivatives and covariances at the pose."""
    whitening: Whitening
    omega: float
    """Weighted sum of squared residuals."""
    redundancy: int
    """Independent conditions minus estimated parameters."""
    iterations: int
    converged: bool
    last_step_std: float
    """Last step in units of its standard deviation."""

    @property
    def sigma0(self) -> float | None:
        """Standard deviation of unit weight a posteriori; None without redundancy."""
        return float(np.sqrt(self.omega / self.redundancy)) if self.redundancy > 0 else None

    def gain(self) -> Array:
        """Give K = Q Jᵀ P, (6, m): how the pose answers to a change of the residuals (dx = -K dr)."""
        whitened = self.whitening.apply(self.system.jacobian)
        return np.asarray(self.whitening.apply_transposed(whitened @ self.cofactors).T)


def solve(
    problem: Problem, start: RigidTransform, held: Array, max_iterations: int, weights: Whitening | None = None
) -> Solution:
    """Iterate dx = -(Jᵀ P J)⁻¹ Jᵀ P r with R <- Exp(w) R, t <- t + dt until the steps vanish.

    Residuals, derivatives and weights are evaluated anew in every round.

    Parameters
    ----------
    problem
        Correspondences between reduced frames (origins near the features).
    start
        Start pose between the reduced frames.
    held
        (6, k) columns b of conditions bᵀ(w, dt) = 0 on every step; k = 0 for a full pose.
    max_iterations
        Limit of rounds.
    weights
        Weights at the start pose, if they are known already.
    """
    size = max(1.0, float(np.abs(problem.target_points()).max()), float(np.abs(problem.source_points()).max()))
    scale = np.array([1.0, 1.0, 1.0, size, size, size])
    free = _complement(held * scale[:, None]) * scale[:, None]
    pose, system = start, problem.linearised(start)
    whitening = whitening_of(system) if weights is None else weights
    moved_since_weights, step_std, iterations, converged = 0.0, np.inf, 0, False
    while not converged and iterations < max_iterations:
        iterations += 1
        jacobian, residuals = whitening.apply(system.jacobian @ free), whitening.apply(system.residuals)
        reduced = np.linalg.lstsq(jacobian, -residuals)[0]
        step = free @ reduced
        step_std = float(np.linalg.norm(jacobian @ reduced))
        pose = RigidTransform.from_components(
            np.asarray(pose.translation) + step[3:], Rotation.from_rotvec(step[:3]) * pose.rotation
        )
        system = problem.linearised(pose)
        share = float(np.abs(step / scale).max())
        moved_since_weights += share
        settled = step_std < STEP_IN_STD or share < STEP_ROUNDING
        if system.joint_covariance is None:
            whitening = whitening_of(system)
        elif moved_since_weights > SAME_WEIGHTS_STEP:
            whitening, moved_since_weights = whitening_of(system), 0.0
            continue
        converged = settled
    jacobian, residuals = whitening.apply(system.jacobian), whitening.apply(system.residuals)
    normal_matrix = jacobian.T @ jacobian
    cofactors = free @ _inverse(free.T @ normal_matrix @ free) @ free.T
    return Solution(
        pose=pose,
        cofactors=0.5 * (cofactors + cofactors.T),
        normal_matrix=normal_matrix,
        system=system,
        whitening=whitening,
        omega=float(residuals @ residuals),
        redundancy=whitening.rank - free.shape[1],
        iterations=iterations,
        converged=converged,
        last_step_std=step_std,
    )


def _complement(directions: Array) -> Array:
    """Give an orthonormal basis (6, 6 - k) of what is perpendicular to k directions."""
    if directions.shape[1] == 0:
        return np.eye(6)
    left = np.linalg.svd(directions, full_matrices=True)[0]
    return np.asarray(left[:, directions.shape[1] :])


def _inverse(normal_matrix: Array) -> Array:
    """Invert a positive definite matrix after scaling its diagonal to one."""
    scale = 1.0 / np.sqrt(np.diag(normal_matrix))
    return np.asarray(np.linalg.inv(normal_matrix * np.outer(scale, scale)) * np.outer(scale, scale))
