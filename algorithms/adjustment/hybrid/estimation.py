"""Least squares of a hybrid network: sparse and damped, zero pivots answered (MATH 3.1, G-08)."""

from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.hybrid.datum import Defect, defect_of
from algorithms.adjustment.hybrid.network import Linearised, Network
from algorithms.adjustment.hybrid.sparse_factor import Factor
from algorithms.adjustment.hybrid.state import State
from algorithms.arrays import Array

STEP_IN_STD = 1e-7
"""A step of this share of its standard deviation changes nothing that anyone could see."""
STALLED_STEP_IN_STD = 1e-5
"""A step below this that is hardly smaller than the last one is made of rounding errors: where something is observed
to a micrometre among coordinates of kilometres, steps never become smaller."""
ROUGH_STEP_IN_STD = 0.3
"""The same while gross errors are looked for: the next step is much smaller and decides no test."""
FIRST_DAMPING, DAMPING_GROWTH, MOST_DAMPING = 1e-3, 10.0, 1e8
WORSE = 1e-9
"""Growth (share) of the weighted squared residuals that counts as worse."""
TAKES_PART = 1e-3
"""An unknown takes part in an undetermined combination with more than this share of its largest element."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """An adjusted network."""

    state: State
    linearised: Linearised
    weights: Array
    """(m,) factors on the weights of the rows, 0 for those that took no part."""
    factor: Factor
    """Normal equations with the free motions held."""
    defect: Defect
    fictitious: Array
    """(k,) unknowns at whose zero pivots a fictitious observation of the present value was inserted (G-08)."""
    omega: float
    """Weighted sum of squared residuals."""
    iterations: int
    converged: bool

    @property
    def used(self) -> int:
        """Number of used observations (MATH 3.1)."""
        return int((self.weights > 0.0).sum())

    @property
    def redundancy(self) -> int:
        """Observations, minus unknowns, plus free motions and undetermined unknowns (MATH 3.1)."""
        return self.used - self.linearised.jacobian.shape[1] + self.defect.count + len(self.fictitious)

    @property
    def sigma0(self) -> float | None:
        """Standard deviation of unit weight a posteriori; None without redundancy (MATH 3.1)."""
        return float(np.sqrt(self.omega / self.redundancy)) if self.redundancy > 0 else None

    def undetermined(self) -> Array:
        """Give (u,) True for unknowns that only fictitious observations hold (MATH 3.1)."""
        found = np.zeros(self.linearised.jacobian.shape[1], dtype=bool)
        if len(self.fictitious):
            right = np.zeros((len(found), len(self.fictitious)))
            right[self.fictitious, np.arange(len(self.fictitious))] = 1.0
            directions = np.abs(self.factor.solved(right) / self.factor.scale[:, None])
            found = (directions > TAKES_PART * directions.max(axis=0)).any(axis=1)
        return found


def estimate(
    network: Network,
    start: State,
    weights: Array,
    max_iterations: int,
    *,
    rough: bool = False,
) -> Estimate:
    """Iterate dx = -(Aᵀ P A)⁻¹ Aᵀ P r until the steps vanish, damping steps that make things worse (MATH 3.1).

    Parameters
    ----------
    network
        Observations.
    start
        Start values.
    weights
        (m,) factors on the weights of the rows.
    max_iterations
        Limit of rounds.
    rough
        Whether a step that decides no test may be the last.
    """
    state, linearised = start, network.linearised(start)
    omega, damping, converged, iterations = _omega(linearised, weights), 0.0, False, 0
    limit, last = ROUGH_STEP_IN_STD if rough else STEP_IN_STD, np.inf
    while not converged and iterations < max_iterations:
        iterations += 1
        defect = defect_of(network, linearised, weights, state)
        factor = factorised(network, linearised, weights, defect, damping)
        step = -factor.solved(linearised.jacobian.T @ (weights * linearised.residuals))
        moved = linearised.jacobian @ step
        length = float(np.sqrt(weights @ (moved * moved)))
        trial = state.moved(network.layout, step)
        trial_linearised = network.linearised(trial)
        trial_omega = _omega(trial_linearised, weights)
        settled = length < max(limit, 1e-9 * np.sqrt(omega)) or last / 2.0 < length < STALLED_STEP_IN_STD
        if not settled and not trial_omega <= omega * (1.0 + WORSE) and damping < MOST_DAMPING:
            damping = max(FIRST_DAMPING, damping * DAMPING_GROWTH)
            continue
        converged, last = bool(settled) and damping == 0.0, length
        damping = damping / DAMPING_GROWTH if damping > FIRST_DAMPING else 0.0
        state, linearised, omega = trial, trial_linearised, trial_omega
    defect = defect_of(network, linearised, weights, state)
    factor = factorised(network, linearised, weights, defect)
    fictitious = np.flatnonzero(factor.helped)
    return Estimate(state, linearised, weights, factor, defect, fictitious, omega, iterations, converged)


def factorised(
    network: Network, linearised: Linearised, weights: Array, defect: Defect, damping: float = 0.0
) -> Factor:
    """Factorise the normal equations with the free motions held (MATH 3.1, 6.2)."""
    added = np.full(network.layout.count, damping)
    added[defect.columns] += 1.0
    return Factor(linearised.jacobian, weights, network.ordering(linearised.jacobian), added)


def _omega(linearised: Linearised, weights: Array) -> float:
    return float(weights @ np.square(linearised.residuals))
