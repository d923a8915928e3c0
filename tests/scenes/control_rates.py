"""How often standard deviations hold, and wrong control points and scales are found, in simulated networks."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from algorithms.adjustment.hybrid.tied_stations import ALPHA, adjust_tied_stations
from tests.scenes.tied_networks import motion_errors, tied_scene

BLUNDER_M = 0.06
CONTROLLABLE_POWER = 0.99
"""A blunder counts as controllable where the test of its point finds it with this probability."""


@dataclass(frozen=True)
class ControlRates:
    """What came out of some networks."""

    coverage: float
    """Share of parameters within 1.96 standard deviations of the truth."""
    nees: float
    """Mean of eᵀ C⁻¹ e over its expectation."""
    removed_in_good: int
    """Observations left out though nothing is wrong."""
    controllable: int
    """Networks in which a planted error of a control point is controllable."""
    found: int
    """Of these, those in which that point was left out."""
    false: int
    """Control points left out beside it."""


def control_rates(networks: int, first_seed: int = 0) -> ControlRates:
    """Adjust networks with five control points, each as it is, and with a gross error in one control point."""
    inside, nees, removed, controllable, found, false = [], [], 0, 0, 0, 0
    for seed in range(first_seed, first_seed + networks):
        rng = np.random.default_rng(seed)
        known = tied_scene(rng)
        good = adjust_tied_stations(known.problem, known.poses)
        errors = motion_errors(good.poses, known.poses)
        inside.append(np.abs(errors) < 1.96 * np.sqrt(np.diag(good.covariance)))
        nees.append(errors @ np.linalg.solve(good.covariance, errors) / len(errors))
        removed += int((~good.seen.used).sum() + (~good.control.used).sum())
        wrong, direction = int(rng.integers(len(known.problem.control))), rng.normal(size=3)
        shift = BLUNDER_M * direction / np.linalg.norm(direction)
        control = known.problem.control
        values = control.values.copy()
        values[wrong] += shift
        spoilt = adjust_tied_stations(replace(known.problem, control=replace(control, values=values)), known.poses)
        false += int((~np.delete(spoilt.control.used, wrong)).sum())
        if (
            _power(control.covariances[wrong], good.point_covariances[control.points[wrong]], shift)
            >= CONTROLLABLE_POWER
        ):
            controllable += 1
            found += int(not spoilt.control.used[wrong])
    return ControlRates(float(np.mean(inside)), float(np.mean(nees)), removed, controllable, found, false)


def _power(known: np.ndarray, adjusted: np.ndarray, shift: np.ndarray) -> float:
    """Give the probability with which the test of a control point, P Qvv P = C⁻¹ - C⁻¹ Cx C⁻¹, finds a shift."""
    weight = np.linalg.inv(known)
    noncentrality = float(shift @ (weight - weight @ adjusted @ weight) @ shift)
    return float(stats.ncx2.sf(stats.chi2.isf(ALPHA, 3), 3, noncentrality))
