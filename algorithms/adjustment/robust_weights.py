"""Robust weights as ORIENT uses them: many gross errors are found before single tests begin (MATH 4.6)."""

from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.problem import AnyProblem
from algorithms.adjustment.snooping import Adjust, adjusted
from algorithms.adjustment.solver import Solution
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, Flags, Scalars

LAST_HALF_WIDTHS = (4.0, 3.0)
"""Half widths h of the last rounds: all within are good (MATH 4.6)."""

SLOWEST_NARROWING = 0.97
"""From round to round h shrinks at least by this factor, so that the rounds end."""


@dataclass(frozen=True, eq=False)
class RobustResult:
    """Observations sorted into good and suspicious ones."""

    solution: Solution
    """Adjusted with the original weights of the good ones."""
    marked: Flags
    """(number of blocks,) True for those that were left out."""
    half_widths: tuple[float, ...]
    """h of each round."""


def weight_factor(distances: Array, half_width: float, slant: float | None = None) -> Array:
    """Give the factor on the weights, 1/(1 + (d/h)^a)²: a quarter at d = h (Haring 2003, eq. 4-3; MATH 4.6).

    Parameters
    ----------
    distances
        d = |v|/sigma with a-priori sigma.
    half_width
        h.
    slant
        s = -1/w'(h), which sets the exponent a = 4h/s; left out it is h, and a = 4.
    """
    exponent = 4.0 * half_width / (half_width if slant is None else slant)
    return np.asarray(1.0 / (1.0 + (distances / half_width) ** exponent) ** 2)


def robust_adjustment(
    problem: AnyProblem, start: Unknowns, adjust: Adjust[AnyProblem], max_rounds: int = 200
) -> RobustResult:
    """Mark gross errors with a weight function that narrows from round to round (Haring 2003, 4.3.5; MATH 4.6).

    Each round sets h between the two largest d of the unmarked blocks, adjusts with the weight factors, and marks what
    lies beyond h; marked ones are computed again and may come back. The last rounds use h = 4 and 3. Blocks of several
    components use d = sqrt(rᵀ C⁻¹ r / dimension).

    Parameters
    ----------
    problem
        All observations.
    start
        Start values.
    adjust
        Adjusts a selection of them.
    max_rounds
        Limit of rounds.

    Raises
    ------
    DegenerateGeometryError
        When the good ones do not determine the unknowns.
    """
    solution = adjusted(problem, start, adjust, rough=True)
    distances = standardised_distances(problem, solution.unknowns)
    marked = np.zeros(len(problem), dtype=bool)
    widths: list[float] = []
    while len(widths) < max_rounds and (not widths or widths[-1] > LAST_HALF_WIDTHS[-1]):
        widths.append(_next_half_width(distances[~marked], widths))
        marked = distances > widths[-1]
        factors = np.sqrt(weight_factor(distances[~marked], widths[-1]))
        solution = adjusted(problem.selected(~marked).scaled(1.0 / factors), solution.unknowns, adjust, rough=True)
        distances = standardised_distances(problem, solution.unknowns)
    marked = distances > LAST_HALF_WIDTHS[-1]
    return RobustResult(adjusted(problem.selected(~marked), solution.unknowns, adjust), marked, tuple(widths))


def standardised_distances(problem: AnyProblem, unknowns: Unknowns) -> Scalars:
    """Give d = sqrt(rᵀ C⁻¹ r / dimension) of every block with its a-priori covariance (MATH 4.6).

    For single observations that is |v|/sigma (Haring 2003, eq. 4-2).
    """
    system = problem.linearised(unknowns)
    found = []
    for residuals, blocks in zip(system.split(system.residuals), system.covariances, strict=True):
        solved = np.linalg.solve(blocks, residuals[:, :, None])[:, :, 0]
        found.append(np.sqrt(np.einsum("ni,ni->n", residuals, solved) / residuals.shape[1]))
    return np.concatenate(found)


def _next_half_width(unmarked: Scalars, widths: list[float]) -> float:
    """Give h between the two largest distances of the unmarked; at least a little narrower than before; 4, then 3."""
    between = float(np.mean(np.sort(unmarked)[-2:]))
    if widths:
        between = min(between, SLOWEST_NARROWING * widths[-1])
    if between > LAST_HALF_WIDTHS[0]:
        return between
    return LAST_HALF_WIDTHS[1] if widths and widths[-1] <= LAST_HALF_WIDTHS[0] else LAST_HALF_WIDTHS[0]
