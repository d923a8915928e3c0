"""Mounts of cameras that are not where they were said to be: gross errors, then trusted less (MATH 2.5, 4.4)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from algorithms.adjustment.gross_errors import GrossErrorSearch, GrossErrorTests, Photo
from algorithms.adjustment.problem import AnyProblem
from algorithms.arrays import Array, Matrix6
from algorithms.geometry.angles import GON_PER_RAD

AS_GOOD = 10.8
"""Mounts whose hypotheses explain the residuals nearly as well are wrong as well, for all one knows: their T is smaller
by less than chance makes of one degree of freedom (0.1 %)."""
LOG_FACTORS = (-10.0, 60.0)
"""Logarithms between which the variance of a mount's error is looked for, in units of what was stated."""
MOST_TIMES = 3
"""So often the mount of one photo is trusted less: other gross errors may bend the first estimate of its error."""
SIDES = ("target", "source")
"""Names of stations 0 and 1."""


@dataclass(frozen=True, eq=False)
class MountError:
    """A mount that contradicts what else is seen, and is therefore trusted less."""

    photo: Photo
    """Station and number."""
    statistic: float
    """T of its hypothesis."""
    critical: float
    """Its limit."""
    omega: float
    """Weighted sum of squared residuals of everything while the mount was trusted."""
    omega_critical: float
    """Its limit in the global test, at the level of single tests."""
    error: Array
    """(6,) estimate of how wrong the stated pose is: rotation vector on the left of the scan axes [rad], translation
    [m]. Of errors that look alike the one is taken that is smallest in units of what was stated."""
    covariance: Matrix6
    """Of that estimate."""

    @property
    def added_covariance(self) -> Matrix6:
        """What the mount's covariance grows by: an error of that size in any direction (MATH 2.5)."""
        return np.diag([self.turn_rad**2] * 3 + [self.shift_m**2] * 3)

    @property
    def turn_rad(self) -> float:
        """By how much the stated pose seems to be turned [rad] (MATH 2.5)."""
        return float(np.linalg.norm(self.error[:3]))

    @property
    def turn_std_rad(self) -> float:
        """Standard deviation of that turn about its axis [rad] (MATH 2.5)."""
        axis = self.error[:3] / max(self.turn_rad, 1e-12)
        return float(np.sqrt(max(axis @ self.covariance[:3, :3] @ axis, 0.0)))

    @property
    def shift_m(self) -> float:
        """By how much it seems to be shifted [m] (MATH 2.5)."""
        return float(np.linalg.norm(self.error[3:]))

    def in_words(self) -> str:
        """Say which photo it is and how wrong it seems to be (MATH 2.5); photos count from 1."""
        turn, turn_std = self.turn_rad * GON_PER_RAD, self.turn_std_rad * GON_PER_RAD
        return (
            f"the lines of photo {self.photo[1] + 1} of the {SIDES[self.photo[0]]} contradict the others as a whole "
            f"(T = {self.statistic:.1f} > {self.critical:.1f}; {self._global}): its camera does not sit where it was "
            f"said to, but turned by about {turn:.3f} gon (std {turn_std:.3f} gon) and "
            f"shifted by about {self.shift_m * 1e3:.1f} mm; the standard deviation of its mount was raised to that"
        )

    @property
    def _global(self) -> str:
        fails = self.omega > self.omega_critical
        return f"the global test {'fails' if fails else 'holds'}: {self.omega:.1f} of {self.omega_critical:.1f}"


def mount_errors(
    problem: AnyProblem,
    search: GrossErrorSearch,
    tests: GrossErrorTests,
    worst: int,
    limit: Callable[[float], float],
) -> tuple[MountError, ...]:
    """Describe a mount that failed its test, and all that explain the residuals nearly as well (MATH 4.4).

    Parameters
    ----------
    problem
        With the mounts' covariances as they are now.
    search, tests
        Of the used correspondences.
    worst
        Number of the hypothesis that failed.
    limit
        Gives the limit of a chi-square value with so many degrees of freedom.
    """
    found, critical, omega = [], limit(float(tests.degrees[worst])), search.global_statistic
    for k, photo in enumerate(tests.photos):
        if photo is None or tests.statistics[k] < max(tests.statistics[worst] - AS_GOOD, critical):
            continue
        station, number = photo
        added = problem.photo_additions.get(station)
        stated = problem.photo_covariances[station][number]
        root = np.linalg.cholesky(stated if added is None else stated + added[number])
        error, covariance = estimated_error(*search.of_mount(k), degrees=float(tests.degrees[k]))
        found.append(
            MountError(
                photo,
                float(tests.statistics[k]),
                critical,
                omega[0],
                limit(float(omega[1])),
                root @ error,
                root @ covariance @ root.T,
            )
        )
    return tuple(found)


def estimated_error(u: Array, own: Array, *, degrees: float) -> tuple[Array, Array]:
    """Estimate the error ∇ of a mount from u = N ∇ + noise of covariance N, with the prior ∇ ~ N(0, λ I) (MATH 4.4).

    λ is such that uᵀ (N + λ N²)⁺ u has its expected value. The estimate is (N + I / λ)⁻¹ u: what is hardly controlled
    does not run away.

    Parameters
    ----------
    u, own
        u (6,) and N (6, 6) of the hypothesis (MATH 4.4), in units of the root of the stated covariance.
    degrees
        Of freedom of the hypothesis, the expected value.

    Returns
    -------
    Estimate (6,) and its covariance (6, 6).
    """
    values, turned = np.linalg.eigh(own)
    values, along = np.maximum(values, 0.0), turned.T @ u

    def excess(log_factor: float) -> float:
        spread = values + np.exp(log_factor) * values**2
        return float((along[spread > 0.0] ** 2 / spread[spread > 0.0]).sum()) - degrees

    factor = np.exp(brentq(excess, LOG_FACTORS[0], LOG_FACTORS[1]) if excess(LOG_FACTORS[0]) > 0.0 else LOG_FACTORS[0])
    covariance = turned @ np.diag(1.0 / (values + 1.0 / factor)) @ turned.T
    return covariance @ u, covariance


def with_less_trust(problem: AnyProblem, errors: Sequence[MountError]) -> AnyProblem:
    """Add to the covariances of mounts what their errors ask for (MATH 2.5)."""
    if not errors:
        return problem
    additions = {
        station: np.array(problem.photo_additions.get(station, np.zeros_like(stated)))
        for station, stated in problem.photo_covariances.items()
    }
    for error in errors:
        station, number = error.photo
        additions[station][number] += error.added_covariance
    return replace(problem, photo_additions=additions)


def may_be_trusted_less(photo: Photo, errors: Sequence[MountError]) -> bool:
    """Tell whether a photo's mount has been trusted less only a few times (MATH 4.5)."""
    return sum(error.photo == photo for error in errors) < MOST_TIMES
