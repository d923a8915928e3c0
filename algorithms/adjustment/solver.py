"""Least squares on the group of rigid motions, sparse and with conditions (MATH 1.4, 3.1, 6.2)."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.inverse import MOST_DENSE, DenseInverse, Information, Inverse, SparseInverse
from algorithms.adjustment.problem import LinearSystem, Problem
from algorithms.adjustment.unknowns import Unknowns
from algorithms.adjustment.weights import Whitening, whitening_of
from algorithms.arrays import Array
from algorithms.errors import DegenerateGeometryError

if TYPE_CHECKING:
    from algorithms.adjustment.hybrid.sparse_factor import Elimination, SymmetricFactor

STEP_IN_STD = 1e-8
"""A step below this share of the standard deviations changes nothing that anyone could see."""

STEP_ROUNDING = 1e-14
"""A step below this share of the problem's size is rounding."""

SAME_WEIGHTS_STEP = 1e-5
"""Joint weights (costly) are computed anew only after the unknowns have moved by more than this share of the size:
below, they change by about as little, and the solution by that share of its standard deviation."""

ROUGH_STEP_IN_STD, ROUGH_SAME_WEIGHTS_STEP = 0.5, 1e-3
"""The same while a search for gross errors goes on: after a step of half a standard deviation the next has at most some
hundredths of it, which decides no test."""

LINEAR_STEP = 1e-4
"""Steps below this share of the size are taken for linear in that search: what is left out is their square."""

SMALLEST_SHARE = 1e-20
"""Share of the largest diagonal element of N below which an unknown is not observed by itself."""

SMALLEST_PIVOT = 1e-13
"""A pivot of the normal equations, scaled to a unit diagonal, below this is zero up to rounding."""

FREE_SHARE = 1e-11
"""Eigenvalues of the scaled normal matrix below this share of the largest belong to what is free."""

MOST_DECOMPOSED = 1800
"""Up to so many unknowns all that is free is found by eigenvectors, which take O(u³)."""

FIRST_DAMPING, DAMPING_GROWTH, MOST_DAMPING = 1e-3, 10.0, 1e9
"""Damping of the scaled normal equations after a step that made the residuals worse, and its changes."""

RUN_AWAY = 1e6
"""An adjustment that moves an unknown by so many times the problem's size is held by nothing: what observations say of
something fades with its distance, so the sum of squares goes on falling."""

MOST_COUPLED, COUPLED_SHARE = 2000, 0.5
"""Up to so many unknowns normal equations are dense if one observation depends on such a share of them."""

WORSE = 1e-6
"""Growth of the weighted squared residuals (share) that counts as worse."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The least squares solution of a problem and everything testing needs (MATH 3.1)."""

    unknowns: Unknowns
    """Adjusted values."""
    held: Array
    """(u, k) columns b of the conditions bᵀ dx = 0 under which it was found."""
    inverse: Inverse
    """Q, the covariance of the free unknowns for sigma0 = 1; for the held conditions b, Q b = 0."""
    information: Information
    """N = Jᵀ P J."""
    system: LinearSystem
    """Residuals, derivatives and covariances at the solution."""
    whitening: Whitening
    omega: float
    """Weighted sum of squared residuals."""
    redundancy: int
    """Independent observations minus determined parameters."""
    iterations: int
    converged: bool
    linear_step: Array | None = None
    """(u,) step from the start values, all of it taken for linear; None where observations were linearised anew."""

    @cached_property
    def cofactors(self) -> Array:
        """(u, u) all of Q; of many stations rather ask `inverse` for the blocks that matter."""
        return self.inverse.whole()

    @property
    def normal_matrix(self) -> Array:
        """(u, u) N, zeros written out."""
        return self.information.dense

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
        whitened = self.whitening.apply(self.system.dense_jacobian)
        return np.asarray(self.whitening.apply_transposed(whitened @ self.cofactors).T)


def solve(
    problem: Problem,
    start: Unknowns,
    held: Array,
    max_iterations: int,
    *,
    linearised: tuple[LinearSystem, Whitening] | None = None,
    rough: bool = False,
) -> Solution:
    """Iterate dx = -(Jᵀ P J)⁻¹ Jᵀ P r with R <- Exp(w) R, t <- t + dt, X <- X + dX until the steps vanish.

    Residuals, derivatives and weights are evaluated anew in every round; a step that makes the residuals worse is
    taken back and damped (Marquardt). The normal equations are sparse and bordered by the held conditions. O(m) and the
    elements of the factor for sparse networks without conditions, O(u³) for a whole inverse.

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
    linearised
        The problem at the start values and its weights, if they are known already.
    rough
        Whether the iteration may end with a step that still matters for the figures, but for no decision.

    Raises
    ------
    DegenerateGeometryError
        When the conditions leave something undetermined, or so weakly determined that the unknowns run away.
    """
    scales = start.scales(problem.extent_m())
    unknowns, system = start, problem.linearised(start) if linearised is None else linearised[0]
    whitening = whitening_of(system) if linearised is None else linearised[1]
    step_limit, weights_limit = (
        (ROUGH_STEP_IN_STD, ROUGH_SAME_WEIGHTS_STEP) if rough else (STEP_IN_STD, SAME_WEIGHTS_STEP)
    )
    moved_since_weights, step_std, iterations, converged, damping = 0.0, np.inf, 0, False, 0.0
    linear_step: Array | None = np.zeros(start.count)
    travelled = np.zeros(start.count)
    omega = _omega(whitening, system)
    equations: NormalEquations | None = None
    while not converged and iterations < max_iterations:
        iterations += 1
        equations = NormalEquations(whitening, system, held, damping, equations)
        step = equations.step()
        step_std = equations.length_in_std(step)
        share = float(np.abs(step / scales).max(initial=0.0))
        settled = step_std < step_limit or share < STEP_ROUNDING
        trial = unknowns.moved(step)
        # a search for gross errors may take small steps for linear: it decides by tests, and ends with a full solution
        linear = rough and share < LINEAR_STEP
        trial_system = system.moved(step) if linear else problem.linearised(trial)
        trial_omega = _omega(whitening, trial_system)
        if not settled and trial_omega > omega * (1.0 + WORSE) and damping < MOST_DAMPING:
            damping = max(FIRST_DAMPING, damping * DAMPING_GROWTH)
            continue
        undamped = damping == 0.0
        damping = damping / DAMPING_GROWTH if damping > FIRST_DAMPING else 0.0
        unknowns, system = trial, trial_system
        travelled += step
        if float(np.abs(travelled / scales).max(initial=0.0)) > RUN_AWAY:
            raise equations.undetermined("a combination of unknowns along which the adjustment runs away")
        linear_step = linear_step + step if linear and linear_step is not None else None
        moved_since_weights += share
        if system.blocks_are_independent:
            whitening = whitening if linear else whitening_of(system)
        elif moved_since_weights > weights_limit:
            whitening, moved_since_weights = whitening_of(system), 0.0
            settled = False
        omega = _omega(whitening, system)
        converged = settled and undamped
    final = NormalEquations(whitening, system, held, 0.0, equations)
    return Solution(
        unknowns=unknowns,
        held=held,
        inverse=final.inverse(),
        information=final.information,
        system=system,
        whitening=whitening,
        omega=omega,
        redundancy=whitening.rank - unknowns.count + held.shape[1],
        iterations=iterations,
        converged=converged,
        linear_step=linear_step,
    )


class NormalEquations:
    """Bordered normal equations [[N, D], [Dᵀ, 0]], scaled to a unit diagonal and factorised (MATH 3.1, 6.2).

    Up to a few hundred unknowns dense matrices are some ten times faster than sparse ones, whose overhead is fixed.
    """

    def __init__(
        self,
        whitening: Whitening,
        system: LinearSystem,
        held: Array,
        damping: float,
        before: "NormalEquations | None" = None,
    ) -> None:
        """Set the equations up and factorise them.

        Parameters
        ----------
        whitening, system
            Of the observations.
        held
            (u, k) columns b of conditions bᵀ dx = 0.
        damping
            Added to the diagonal of the scaled matrix.
        before
            Those of an earlier round, whose order of elimination is kept where the pattern is the same.
        """
        self._whitening, self._jacobian = whitening, system.jacobian
        weighted = whitening.apply_transposed(whitening.apply(system.residuals))
        self._right = -np.asarray(system.jacobian.T @ weighted)
        self._normal = _normal_matrix(whitening, system)
        diagonal = np.asarray(self._normal.diagonal())
        self._scale = 1.0 / np.sqrt(np.maximum(diagonal, SMALLEST_SHARE * diagonal.max(initial=0.0)))
        border = np.linalg.qr(held * self._scale[:, None])[0] if held.shape[1] else held
        scaled = self._normal * self._scale[:, None] * self._scale[None, :]
        self.ordering: Elimination | None = None
        """Order of elimination of sparse equations without conditions."""
        self._factor: SymmetricFactor | None = None
        if isinstance(scaled, np.ndarray):
            solver = _dense_solver(scaled + damping * np.eye(len(scaled)), border)
        elif held.shape[1]:
            solver = _bordered_solver(scaled + damping * sparse.eye_array(len(self._scale)), border)
        else:
            solver = self._sparse_solver(damping, None if before is None else before.ordering)
        self._scaled, self._border = scaled, border
        if solver is None:
            raise self.undetermined("a combination of unknowns that no observation depends on")
        self._solver = solver

    @property
    def information(self) -> Information:
        """N = Jᵀ P J, (u, u)."""
        return Information(self._normal if isinstance(self._normal, np.ndarray) else sparse.csc_array(self._normal))

    def _sparse_solver(self, damping: float, ordering: "Elimination | None") -> Callable[[Array], Array] | None:
        """Factorise N without conditions; the solver is for the scaled equations, as those of the others are."""
        from algorithms.adjustment.hybrid.sparse_factor import Elimination, SymmetricFactor  # loads compiled loops

        matrix = sparse.csc_array(self._normal)
        matrix.sort_indices()
        if ordering is None or not ordering.has_pattern_of(matrix):
            ordering = Elimination.of_pattern(matrix)
        added = np.full(matrix.shape[1], damping)
        factor = SymmetricFactor.of_matrix(matrix, ordering, added, SMALLEST_PIVOT)
        self.ordering, self._factor = ordering, factor
        if factor.helped.any():
            return None
        return lambda right: factor.solved(right / self._scale[:, None]) / self._scale[:, None]

    def undetermined(self, what: str) -> DegenerateGeometryError:
        """Find what the observations and the conditions leave free, or hold least. O(u³) for up to 1800 unknowns.

        Parameters
        ----------
        what
            Names it in words.
        """
        u, k = self._border.shape
        if self._factor is not None and u > MOST_DECOMPOSED:
            free = self._factor.free_directions()
            advice = "add observations, or a datum that holds it"
            return DegenerateGeometryError(u - free.shape[1], (what,), free, advice, parameters=u)
        dense = self._scaled if isinstance(self._scaled, np.ndarray) else self._scaled.toarray()
        allowed = np.linalg.svd(self._border, full_matrices=True)[0][:, k:] if k else np.eye(u)
        values, vectors = np.linalg.eigh(allowed.T @ dense @ allowed)
        free = values < FREE_SHARE * max(values[-1], np.finfo(np.float64).tiny)
        free[0] = True  # the factorisation failed, or the adjustment: so the least one is free
        return DegenerateGeometryError(
            u - int(free.sum()),
            (what,),
            self._scale[:, None] * (allowed @ vectors[:, free]),
            "add observations, or a datum that holds it",
            parameters=u,
        )

    def step(self) -> Array:
        """Solve for the step dx, (u,)."""
        return self._solved((self._right * self._scale)[:, None])[:, 0]

    def length_in_std(self, step: Array) -> float:
        """Give the length of a step in units of its standard deviation, sqrt(dxᵀ N dx)."""
        return float(np.linalg.norm(self._whitening.apply(self._jacobian @ step)))

    def inverse(self) -> Inverse:
        """Give Q, the inverse of N under the conditions."""
        if self._factor is not None:
            return SparseInverse(self._factor)
        inverse = self._solved(np.diag(self._scale))
        return DenseInverse(np.asarray(0.5 * (inverse + inverse.T)))

    def _solved(self, right: Array) -> Array:
        return np.asarray(self._solver(right) * self._scale[:, None])


def _normal_matrix(whitening: Whitening, system: LinearSystem) -> Any:
    """Give N = Jᵀ P J, (u, u): sparse where there are many unknowns and no observation couples most of them.

    One plane that all stations see makes N full; then blocks of rows are multiplied as dense matrices.
    """
    matrix, jacobian, u = whitening.matrix, system.jacobian, system.jacobian.shape[1]
    if isinstance(matrix, np.ndarray) or u <= MOST_DENSE:
        white = matrix @ system.dense_jacobian
        return white.T @ white
    if u > MOST_COUPLED or np.diff(jacobian.indptr).max(initial=0) < COUPLED_SHARE * u:
        white = matrix @ jacobian
        return white.T @ white
    from algorithms.adjustment.hybrid.factor_kernels import normal_of_blocks  # loads compiled loops

    sizes = np.concatenate([np.full(n, d, dtype=np.int64) for n, d in system.shapes])
    return normal_of_blocks(sizes, matrix.data, jacobian.indptr, jacobian.indices, jacobian.data, u)


def _dense_solver(matrix: Array, border: Array) -> Callable[[Array], Array] | None:
    u, k = border.shape
    bordered = np.block([[matrix, border], [border.T, np.zeros((k, k))]])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", linalg.LinAlgWarning)  # an exactly singular matrix is found by its pivot
        factors = linalg.lu_factor(bordered)
    if np.abs(np.diagonal(factors[0])).min(initial=np.inf) < SMALLEST_PIVOT:
        return None
    return lambda right: np.asarray(linalg.lu_solve(factors, np.pad(right, ((0, k), (0, 0))))[:u])


def _bordered_solver(matrix: sparse.sparray, border: Array) -> Callable[[Array], Array] | None:
    u, k = border.shape
    conditions = sparse.csc_array(border)
    matrix = sparse.block_array([[matrix, conditions], [conditions.T, None]])
    try:
        factors = splu(sparse.csc_array(matrix))
    except RuntimeError:  # an exactly singular factor: SuperLU has no other way to say so
        return None
    if np.abs(factors.U.diagonal()).min(initial=np.inf) < SMALLEST_PIVOT:
        return None
    return lambda right: np.asarray(factors.solve(np.pad(right, ((0, k), (0, 0))))[:u])


def _omega(whitening: Whitening, system: LinearSystem) -> float:
    whitened = whitening.apply(system.residuals)
    return float(whitened @ whitened)
