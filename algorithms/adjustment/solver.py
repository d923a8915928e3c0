"""Least squares on the group of rigid motions, sparse and with conditions (MATH 1.4, 3.1, 6.2)."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.problem import LinearSystem, Problem
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.weights import Whitening, whitening_of
from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError

STEP_IN_STD = 1e-8
"""A step below this share of the standard deviations changes nothing that anyone could see."""

STEP_ROUNDING = 1e-14
"""A step below this share of the problem's size is rounding."""

SAME_WEIGHTS_STEP = 1e-5
"""Joint weights (costly) are computed anew only after the unknowns have moved by more than this share of the size:
below, they change by about as little, and the solution by that share of its standard deviation."""

SMALLEST_SHARE = 1e-20
"""Share of the largest diagonal element of N below which an unknown is not observed by itself."""

SMALLEST_PIVOT = 1e-13
"""A pivot of the normal equations, scaled to a unit diagonal, below this is zero up to rounding."""

FIRST_DAMPING, DAMPING_GROWTH, MOST_DAMPING = 1e-3, 10.0, 1e9
"""Damping of the scaled normal equations after a step that made the residuals worse, and its changes."""

WORSE = 1e-6
"""Growth of the weighted squared residuals (share) that counts as worse."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The least squares solution of a problem and everything testing needs."""

    unknowns: Unknowns
    """Adjusted values."""
    held: Array
    """(u, k) columns b of the conditions bᵀ dx = 0 under which it was found."""
    cofactors: Array
    """(u, u) Q, the covariance of the free unknowns for sigma0 = 1; for the held conditions b, Q b = 0."""
    normal_matrix: Array
    """(u, u) N = Jᵀ P J."""
    system: LinearSystem
    """Residuals, derivatives and covariances at the solution."""
    whitening: Whitening
    omega: float
    """Weighted sum of squared residuals."""
    redundancy: int
    """Independent observations minus determined parameters."""
    iterations: int
    converged: bool
    last_step_std: float
    """Last step in units of its standard deviation."""

    @property
    def pose(self) -> RigidTransform:
        """Pose of station 1 in the frame of station 0: target from source of a pair."""
        return self.unknowns.poses[0].inv() * self.unknowns.poses[1]

    @property
    def sigma0(self) -> float | None:
        """Standard deviation of unit weight a posteriori; None without redundancy."""
        return float(np.sqrt(self.omega / self.redundancy)) if self.redundancy > 0 else None

    def gain(self) -> Array:
        """Give K = Q Jᵀ P, (u, m): how the unknowns answer to a change of the residuals (dx = -K dr)."""
        whitened = self.whitening.apply(self.system.jacobian.toarray())
        return np.asarray(self.whitening.apply_transposed(whitened @ self.cofactors).T)


def solve(
    problem: Problem,
    start: Unknowns,
    held: Array,
    max_iterations: int,
    weights: Whitening | None = None,
    settled_std: float = STEP_IN_STD,
) -> Solution:
    """Iterate dx = -(Jᵀ P J)⁻¹ Jᵀ P r with R <- Exp(w) R, t <- t + dt, X <- X + dX until the steps vanish.

    Residuals, derivatives and weights are evaluated anew in every round; a step that makes the residuals worse is
    taken back and damped (Marquardt). The normal equations are sparse and bordered by the held conditions. O(m) for
    sparse networks, O(u³) for their full inverse.

    Parameters
    ----------
    problem
        Observations, in reduced frames (origins near the features).
    start
        Start values.
    held
        (u, k) columns b of conditions bᵀ dx = 0 on every step: a datum, or what is not determined; k = 0 for none.
    max_iterations
        Limit of rounds.
    weights
        Weights at the start values, if they are known already.
    settled_std
        Length of a step, in units of its standard deviation, with which the iteration may end.

    Raises
    ------
    DegenerateGeometryError
        When the conditions leave something undetermined.
    """
    scales = start.scales(problem.extent_m())
    unknowns, system = start, problem.linearised(start)
    whitening = whitening_of(system) if weights is None else weights
    moved_since_weights, step_std, iterations, converged, damping = 0.0, np.inf, 0, False, 0.0
    omega = _omega(whitening, system)
    while not converged and iterations < max_iterations:
        iterations += 1
        equations = NormalEquations(whitening, system, held, damping)
        step = equations.step()
        step_std = equations.length_in_std(step)
        share = float(np.abs(step / scales).max(initial=0.0))
        settled = step_std < settled_std or share < STEP_ROUNDING
        trial = unknowns.moved(step)
        trial_system = problem.linearised(trial)
        trial_omega = _omega(whitening, trial_system)
        if not settled and trial_omega > omega * (1.0 + WORSE) and damping < MOST_DAMPING:
            damping = max(FIRST_DAMPING, damping * DAMPING_GROWTH)
            continue
        undamped = damping == 0.0
        damping = damping / DAMPING_GROWTH if damping > FIRST_DAMPING else 0.0
        unknowns, system = trial, trial_system
        moved_since_weights += share
        if not system.plane_jacobians:
            whitening = whitening_of(system)
        elif moved_since_weights > SAME_WEIGHTS_STEP:
            whitening, moved_since_weights = whitening_of(system), 0.0
            settled = False
        omega = _omega(whitening, system)
        converged = settled and undamped
    final = NormalEquations(whitening, system, held, 0.0)
    return Solution(
        unknowns=unknowns,
        held=held,
        cofactors=final.cofactors(),
        normal_matrix=final.matrix,
        system=system,
        whitening=whitening,
        omega=omega,
        redundancy=whitening.rank - unknowns.count + held.shape[1],
        iterations=iterations,
        converged=converged,
        last_step_std=step_std,
    )


class NormalEquations:
    """Bordered normal equations [[N, D], [Dᵀ, 0]], scaled to a unit diagonal and factorised."""

    def __init__(self, whitening: Whitening, system: LinearSystem, held: Array, damping: float) -> None:
        self._jacobian = whitening.matrix @ system.jacobian
        self._right = -np.asarray(self._jacobian.T @ whitening.apply(system.residuals))
        self._normal = sparse.csc_array(self._jacobian.T @ self._jacobian)
        diagonal = np.asarray(self._normal.diagonal())
        self._scale = 1.0 / np.sqrt(np.maximum(diagonal, SMALLEST_SHARE * diagonal.max(initial=0.0)))
        self._factors = self._factorised(held * self._scale[:, None], damping)

    @property
    def matrix(self) -> Array:
        """(u, u) N = Jᵀ P J."""
        return np.asarray(self._normal.toarray())

    def step(self) -> Array:
        """Solve for the step dx, (u,)."""
        u = len(self._scale)
        right = np.zeros(self._factors.shape[0])
        right[:u] = self._right * self._scale
        return np.asarray(self._factors.solve(right)[:u] * self._scale)

    def length_in_std(self, step: Array) -> float:
        """Give the length of a step in units of its standard deviation, sqrt(dxᵀ N dx)."""
        return float(np.linalg.norm(self._jacobian @ step))

    def cofactors(self) -> Array:
        """Give Q, (u, u), the inverse of N under the conditions."""
        u = len(self._scale)
        right = np.zeros((self._factors.shape[0], u))
        right[:u] = np.diag(self._scale)
        inverse = self._factors.solve(right)[:u] * self._scale[:, None]
        return np.asarray(0.5 * (inverse + inverse.T))

    def _factorised(self, border: Array, damping: float) -> SuperLU:
        u, k = border.shape
        matrix = self._normal * self._scale[:, None] * self._scale[None, :] + damping * sparse.eye_array(u)
        if k:
            conditions = sparse.csc_array(np.linalg.qr(border)[0])
            matrix = sparse.block_array([[matrix, conditions], [conditions.T, None]])
        try:
            factors = splu(sparse.csc_array(matrix))
        except RuntimeError as error:  # an exactly singular factor
            raise _undetermined(u) from error
        if np.abs(factors.U.diagonal()).min(initial=np.inf) < SMALLEST_PIVOT:
            raise _undetermined(u)
        return factors


def _undetermined(unknowns: int) -> DegenerateGeometryError:
    return DegenerateGeometryError(
        unknowns - 1,
        ("a combination of unknowns that no observation depends on",),
        advice="add observations, or a datum that holds it",
    )


def _omega(whitening: Whitening, system: LinearSystem) -> float:
    whitened = whitening.apply(system.residuals)
    return float(whitened @ whitened)
