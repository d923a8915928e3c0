"""Many noisy adjustments of one kind of scene, and what their standard deviations and tests promise against the truth.

With the true noise known a priori, the normalised squared error of the pose is chi-square with six degrees, Omega with
the redundancy, each w standard normal, and an error of exactly the detectable size is found with the chosen power.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from algorithms.adjustment.testing import normal_critical_value
from tests.scenes.buildings.plane_rooms import observed_rooms, plane_rooms
from tests.scenes.lines.line_scenes import (
    LINE_SCENES,
    ObservedPair,
    generic_lines,
    normalised_error,
    observed_pair,
    one_line_shifted,
)
from tests.scenes.lines.line_scenes import pose_error as error_of

ALPHA = 0.001
"""Level of single tests (the default of the options)."""
FITTED = "generic 24, fitted"
"""Lines fitted to noisy points instead of drawn from the covariance of such fits."""
PLANE_ROOM = "plane room, 12 edges"
PLANE_ROOMS = "plane rooms, 24 edges, 3 pipes"
NAMES = (*LINE_SCENES, PLANE_ROOM, PLANE_ROOMS)
"""Those of MATH 10, and rooms whose edges are correlated through the planes they share."""


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """What T adjustments of new scenes of one kind gave."""

    nees: np.ndarray
    """(T,) normalised squared errors of the pose."""
    normalised_errors: np.ndarray
    """(T, 6) error of each parameter over its standard deviation."""
    omegas: np.ndarray
    """(T,)."""
    redundancies: np.ndarray
    """(T,)."""
    w_rejected: np.ndarray
    """(T,) number of components whose |w| exceeds the limit."""
    w_tested: np.ndarray
    """(T,) number of controlled components."""
    w_squares: np.ndarray
    """(T,) sum of w² over the controlled components."""
    lines_rejected: np.ndarray
    """(T,) number of lines whose T exceeds the limit."""
    lines_tested: np.ndarray
    """(T,) number of controlled lines."""
    planted_found: np.ndarray
    """(T, k) True where an error of the detectable size was found in its component."""

    @property
    def mean_nees(self) -> float:
        """Mean NEES: 6 for honest covariances."""
        return float(self.nees.mean())

    @property
    def ellipsoid_coverage(self) -> float:
        """Share of poses inside their 95 % ellipsoid of all six parameters."""
        return float((self.nees < stats.chi2.ppf(0.95, 6)).mean())

    @property
    def interval_coverage(self) -> float:
        """Share of parameters inside their 95 % interval."""
        return float((np.abs(self.normalised_errors) < stats.norm.ppf(0.975)).mean())

    @property
    def reported_over_true(self) -> np.ndarray:
        """(6,) standard deviation as reported over that of the true errors."""
        return np.asarray(1.0 / np.sqrt((self.normalised_errors**2).mean(axis=0)))

    @property
    def omega_over_redundancy(self) -> float:
        """Mean variance factor."""
        return float(self.omegas.sum() / self.redundancies.sum())

    @property
    def type_one_error(self) -> float:
        """Share of good components whose |w| exceeds the limit."""
        return float(self.w_rejected.sum() / self.w_tested.sum())

    @property
    def type_one_std(self) -> float:
        """Standard deviation of `type_one_error`, from its scatter between runs: w of one run are correlated.

        At least that of independent tests of level 0.1 %, for series in which hardly any test rejects.
        """
        excess = self.w_rejected - self.type_one_error * self.w_tested
        tested = float(self.w_tested.sum())
        return float(np.sqrt(max((excess**2).sum(), ALPHA * (1.0 - ALPHA) * tested)) / tested)

    @property
    def power(self) -> float:
        """Share of planted errors that were found."""
        return float(self.planted_found.mean())


def scene_pairs(name: str) -> Callable[[np.random.Generator], ObservedPair]:
    """Give a function that draws a new observed pair of the named kind: those of MATH 10, and rooms of planes."""
    if name == PLANE_ROOM:
        return lambda rng: observed_rooms(plane_rooms(rng, lines=12, rooms=1, bodies=0), rng)
    if name == PLANE_ROOMS:
        return lambda rng: observed_rooms(plane_rooms(rng), rng, pipes=generic_lines(rng, 3))
    if name == FITTED:
        return lambda rng: observed_pair(generic_lines(rng, 24), rng, fitted=True)
    make = LINE_SCENES[name]
    return lambda rng: observed_pair(make(rng), rng)


def run_monte_carlo(
    draw: Callable[[np.random.Generator], ObservedPair], runs: int, rng: np.random.Generator, *, plants: int
) -> MonteCarlo:
    """Adjust new pairs, and again with an error of the detectable size planted in one component.

    Parameters
    ----------
    draw
        Gives a new pair.
    runs
        Number T of pairs.
    rng
        Of all randomness.
    plants
        How many errors are planted in each pair, one after the other.
    """
    limit = normal_critical_value(ALPHA)
    rows: list[tuple[float, ...]] = []
    errors, found = [], []
    for _ in range(runs):
        pair = draw(rng)
        result = pair.adjusted()
        w, controlled = result.lines.w, result.lines.controlled
        tested = result.lines.degrees > 0
        rows.append(
            (
                normalised_error(result, pair.pose),
                result.omega,
                result.redundancy,
                (np.abs(w[controlled]) > limit).sum(),
                controlled.sum(),
                (w[controlled] ** 2).sum(),
                (result.lines.statistics[tested] > result.lines.critical[tested]).sum(),
                tested.sum(),
            )
        )
        std = np.sqrt(np.diag(result.pose.covariance))
        errors.append(error_of(result.pose.target_from_source, pair.pose) / std)
        found.append([_is_found(pair, result.lines.detectable, rng, limit) for _ in range(plants)])
    columns = np.array(rows).T
    return MonteCarlo(
        nees=columns[0],
        normalised_errors=np.array(errors),
        omegas=columns[1],
        redundancies=columns[2],
        w_rejected=columns[3],
        w_tested=columns[4],
        w_squares=columns[5],
        lines_rejected=columns[6],
        lines_tested=columns[7],
        planted_found=np.array(found, dtype=bool).reshape(runs, plants),
    )


def _is_found(pair: ObservedPair, detectable: np.ndarray, rng: np.random.Generator, limit: float) -> bool:
    """Plant the detectable error, of either sign, in one controlled component and look whether its w exceeds.

    Only in lines that are no edges of planes: an edge is a function of its planes, and one that is changed alone
    contradicts them in what is otherwise exact.
    """
    free = pair.target.parents[pair.correspondences[:, 0], 0] < 0
    k, component = rng.choice(np.argwhere(np.isfinite(detectable) & free[:, None]))
    size = detectable[k, component] * rng.choice([-1.0, 1.0])
    planted = one_line_shifted(pair, int(k), int(component), float(size))
    return bool(np.abs(planted.adjusted().lines.w[k, component]) > limit)
