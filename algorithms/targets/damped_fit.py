"""Damped least squares (Levenberg and Marquardt) whose residuals and derivatives are computed together."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.optimize import leastsq

from algorithms.arrays import Array, Scalars

Model: TypeAlias = Callable[[Array], tuple[Scalars, Array]]
"""Gives residuals (n,) and their derivatives (n, k) at parameters (k,)."""
TOLERANCE = 1e-8


@dataclass(frozen=True, eq=False)
class DampedFit:
    """Where the sum of squares is least."""

    solution: Array
    """(k,)."""
    residuals: Scalars
    """(n,)."""
    jacobian: Array
    """(n, k)."""


def damped_fit(
    model: Model, start: Array, *, most_evaluations: int, scale: Array | None = None, x_tolerance: float = TOLERANCE
) -> DampedFit:
    """Minimise a sum of squares with MINPACK's `lmder`.

    Parameters
    ----------
    model
        Residuals and derivatives.
    start
        (k,) parameters to begin with.
    most_evaluations
        The search ends after so many.
    scale
        (k,) size of each parameter; without it, the columns of the derivatives tell it.
    x_tolerance
        Relative change of the scaled parameters that ends the search.
    """
    last: dict[bytes, tuple[Scalars, Array]] = {}

    def seen(x: Array) -> tuple[Scalars, Array]:
        # the solver asks for residuals and derivatives of the same place one after the other
        key = x.tobytes()
        if key not in last:
            last.clear()
            last[key] = model(x.copy())
        return last[key]

    # what it makes by the way, the inverse of the normal equations, may be beyond all numbers
    with np.errstate(over="ignore", invalid="ignore"):
        found = leastsq(
            lambda x: seen(x)[0],
            start,
            Dfun=lambda x: seen(x)[1],
            full_output=True,
            ftol=TOLERANCE,
            xtol=x_tolerance,
            gtol=TOLERANCE,
            maxfev=most_evaluations,
            diag=None if scale is None else 1.0 / scale,
        )
    solution = np.asarray(found[0])
    return DampedFit(solution, *seen(solution))
