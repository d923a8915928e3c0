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
LEAST_FREEDOM = 3.0
"""Of a variance, however few independent residuals tell it."""
MOST_LEVERAGE = 0.95


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


def gain_of(design: Array) -> Array:
    """Give the derivatives (n, k) of the parameters by the measurements from those of the measurements (n, k)."""
    return np.asarray(design @ np.linalg.pinv(design.T @ design, hermitian=True))


def residual_covariance(design: Array, gain: Array, residuals: Scalars) -> Array:
    """Give the covariance (k, k) of parameters from the residuals themselves, measurements being independent.

    Parameters
    ----------
    design, gain, residuals
        As of `error_parts`.
    """
    parts = error_parts(design, gain, residuals)
    return np.asarray(parts.T @ parts)


def error_parts(design: Array, gain: Array, residuals: Scalars) -> Array:
    """Give what each measurement moves the parameters by, (n, k), as its residual tells it (White 1980, form HC3).

    The sum of their squares is a variance. Few residuals may tell it: it is larger by as much as that of a t
    distribution is than 1, whose degrees of freedom are those of the variance as a quadratic form of equal errors (Bell
    and McCaffrey 2002).

    Parameters
    ----------
    design
        (n, k) derivatives of the measurements by the parameters.
    gain
        (n, k) derivatives of the parameters by the measurements.
    residuals
        (n,).
    """
    leverage = np.minimum(np.einsum("ij,ij->i", gain, design), MOST_LEVERAGE)
    parts = gain * (residuals / (1.0 - leverage))[:, None]
    for k in range(parts.shape[1]):
        share = (gain[:, k] / (1.0 - leverage)) ** 2
        mean = float(np.sum(share * (1.0 - leverage)))
        projected = float(np.sum(((gain.T * share) @ gain) * ((design.T * share) @ design)))
        # twice the squared mean of a quadratic form over its own variance
        square = float(np.sum(share**2 * (1.0 - 2.0 * leverage))) + projected
        freedom = max(mean**2 / max(square, 1e-300), LEAST_FREEDOM)
        parts[:, k] *= np.sqrt(freedom / (freedom - 2.0))
    return np.asarray(parts)
