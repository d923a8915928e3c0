"""A board's crossing in the intensities of its plane: two blurred edges by least squares."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from algorithms.arrays import Array, Scalars, Vectors2
from algorithms.targets.damped_fit import damped_fit, gain_of, residual_covariance

ANGLES = np.deg2rad(np.arange(0.0, 90.0, 7.5))
SHIFTS = np.linspace(-0.16, 0.16, 5)
"""Of the first search, in sides of the board."""
MOST_SEARCHED, LEAST_SEARCHED = 500, 12
BLUR_PRIOR = 0.7
"""Standard deviation of the logarithm of the blur: it is the sampling's and the beam's, within a factor of two."""
SLOPE_PRIOR = 0.1
"""Standard deviation of the brightness' relative change from the middle of the board to its rim: the nearer rim of a
slanting board is brighter."""
FIRST_EVALUATIONS, HOPELESS = 25, 0.4
"""A crossing is found in so many; a template that with equal weights, which leave the least sum of squares, explains
less than such a share of the intensities is not looked at more closely."""
TEMPLATE_SHARE = 0.46
"""So far from the crossing, in sides, the board's own points are taken: its rim is blurred with what is behind."""


@dataclass(frozen=True, eq=False)
class CrossingFit:
    """Where two edges cross, and how well that is known."""

    place: Array
    """(2,) in the plane [m]."""
    covariance: Array
    """(2, 2) [m²]."""
    angles_rad: Array
    """(2,) directions of the two edges' normals."""
    dark: float
    bright: float
    agreement: float
    """Share of the intensities' variance that the template explains, 0..1 (negative: worse than their mean), less what
    as many parameters would explain of chance (Theil 1961)."""
    rms: float
    """Residuals relative to half the contrast."""
    blurs_m: Array
    """(2,) standard deviations of the edges' blur [m]."""

    def across(self, places: Vectors2) -> Array:
        """Give the distances (n, 2) of places from the two edges [m]."""
        normals = np.stack([np.cos(self.angles_rad), np.sin(self.angles_rad)])
        return np.asarray((places - self.place) @ normals)


def searched_crossing(places: Vectors2, intensities: Scalars, size_m: float) -> tuple[Array, float, float]:
    """Find roughly where and how a checker crossing of sharp edges lies.

    Returns
    -------
    Place (2,) [m], direction of one edge's normal [rad], and correlation with the template, -1..1; its sign tells which
    squares are bright.
    """
    step = max(1, len(places) // MOST_SEARCHED)
    places, intensities = places[::step], intensities[::step]
    if len(places) == 0:
        return np.zeros(2), 0.0, 0.0
    values = (intensities - intensities.mean())[:, None]
    shifts, limit = SHIFTS * size_m, TEMPLATE_SHARE * size_m
    correlations = []
    for angle in ANGLES:
        turned = places @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        # sums over the points inside each shifted square are products of what is inside along either side
        first, second = turned[:, :1] - shifts, turned[:, 1:] - shifts
        rows, columns = (np.abs(side) < limit for side in (first, second))
        rows, columns = rows.astype(np.float64), columns.astype(np.float64)
        signed = np.sign(first) * rows, np.sign(second) * columns
        count = rows.T @ columns
        n = np.maximum(count, 1.0)
        mean, square = (values * rows).T @ columns / n, (values**2 * rows).T @ columns / n
        sign = signed[0].T @ signed[1] / n
        spread = np.sqrt(np.maximum((square - mean**2) * (1.0 - sign**2), 0.0))
        both = (values * signed[0]).T @ signed[1] / n - mean * sign
        usable = (count >= LEAST_SEARCHED) & (spread > 0.0)
        correlations.append(np.where(usable, both / np.where(usable, spread, 1.0), 0.0))
    whole = np.array(correlations)
    best = np.unravel_index(np.argmax(np.abs(whole)), whole.shape)
    angle, x, y = float(ANGLES[best[0]]), shifts[best[1]], shifts[best[2]]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([cosine * x - sine * y, sine * x + cosine * y]), angle, float(whole[best])


def fit_crossing(
    places: Vectors2, intensities: Scalars, start: tuple[Array, float, float], blur_m: float, reach_m: float
) -> CrossingFit | None:
    """Fit I = g (level + half contrast * erf(d1 / s1 sqrt 2) * erf(d2 / s2 sqrt 2)) with d the distances from two edges
    and g a brightness that is 1 in the middle and changes evenly along the board.

    Bright surfaces scatter more than dark ones and edges more than surfaces, so each measurement's weight is that of
    its level, and the covariance is taken from the residuals themselves (White 1980, in the form HC3).

    Parameters
    ----------
    places
        (n, 2) in the plane [m], on the board.
    intensities
        (n,) any linear scale.
    start
        Place, angle and correlation of `searched_crossing`.
    blur_m
        Expected standard deviation of the edges' blur: half the spacing of the points, or the beam's [m].
    reach_m
        So far from the start at most the crossing lies [m].

    Returns
    -------
    The fit, or None where it does not settle near the start. What is hopeless is fitted roughly.
    """
    place, angle, correlation = start
    level, half = float(np.mean(intensities)), float(np.sign(correlation) * np.std(intensities))
    unit = float(np.std(intensities))
    if unit <= 0.0:
        return None
    blur = np.log(blur_m)
    first = np.array([place[0], place[1], angle, angle + 0.5 * np.pi, level, half, blur, blur, 0.0, 0.0])
    middle = places.mean(axis=0)
    along = (places - middle) / max(float(np.abs(places - middle).max()), 1e-300)
    weights = np.full(len(places), 1.0 / unit)
    prior = np.diag([1.0 / BLUR_PRIOR] * 2 + [1.0 / SLOPE_PRIOR] * 2)
    prior = np.column_stack([np.zeros((4, 6)), prior])
    solution = first
    whole = float(np.sum((intensities - intensities.mean()) ** 2))
    for most in (FIRST_EVALUATIONS, 60, 60):

        def model(x: Array, weights: Array = weights) -> tuple[Scalars, Array]:
            value, derivatives = _model(x, places, along)
            residuals = np.append((value - intensities) * weights, prior @ (x - first))
            return residuals, np.vstack([derivatives * weights[:, None], prior])

        solution = damped_fit(model, solution, most_evaluations=most).solution
        # also what is no number is not near
        if not float(np.linalg.norm(solution[:2] - place)) <= reach_m:
            return None
        values, _ = _model(solution, places, along)
        misfits = intensities - values
        share = np.clip((values - solution[4]) / (2.0 * abs(solution[5]) + 1e-300) + 0.5, 0.0, 1.0)
        dark, bright = _spread(misfits, share < 0.15), _spread(misfits, share > 0.85)
        between = _spread(misfits, (share >= 0.15) & (share <= 0.85))
        variances = (1.0 - share) * dark**2 + share * bright**2 + 4.0 * share * (1.0 - share) * between**2
        weights = 1.0 / np.sqrt(np.maximum(variances, (1e-4 * unit) ** 2))
        if np.sum(misfits**2) > (1.0 - HOPELESS) * whole:
            break
    values, derivatives = _model(solution, places, along)
    misfits = intensities - values
    half = abs(float(solution[5]))
    design, n = derivatives * weights[:, None], len(places)
    gain = gain_of(np.vstack([design, prior]))
    covariance = residual_covariance(design, gain[:n], misfits * weights) + gain[n:].T @ gain[n:]
    return CrossingFit(
        place=solution[:2],
        covariance=covariance[:2, :2],
        angles_rad=solution[2:4],
        dark=float(solution[4]) - half,
        bright=float(solution[4]) + half,
        agreement=1.0 - float(np.sum(misfits**2)) / whole * (len(places) - 1) / max(len(places) - len(first), 1),
        rms=float(np.sqrt(np.mean(misfits**2))) / half if half > 0.0 else np.inf,
        blurs_m=np.exp(solution[6:8]),
    )


def _model(x: Array, places: Vectors2, along: Vectors2) -> tuple[Array, Array]:
    """Give the template's intensities (n,) and their derivatives (n, 10)."""
    shifted = places - x[:2]
    edges, slopes, turned, blurred = [], [], [], []
    for angle, blur in ((x[2], np.exp(x[6])), (x[3], np.exp(x[7]))):
        distance = shifted @ np.array([np.cos(angle), np.sin(angle)])
        beside = shifted @ np.array([-np.sin(angle), np.cos(angle)])
        # a step of the iteration may go anywhere; beyond 40 standard deviations nothing is left
        slope = np.sqrt(2.0 / np.pi) / blur * np.exp(-0.5 * np.clip(distance / blur, -40.0, 40.0) ** 2)
        edges.append(special.erf(distance / (np.sqrt(2.0) * blur)))
        slopes.append(slope)
        turned.append(slope * beside)
        blurred.append(-slope * distance)
    product = edges[0] * edges[1]
    out = np.empty((len(places), 10))
    by_first, by_second = slopes[0] * edges[1], edges[0] * slopes[1]
    out[:, 0] = -x[5] * (by_first * np.cos(x[2]) + by_second * np.cos(x[3]))
    out[:, 1] = -x[5] * (by_first * np.sin(x[2]) + by_second * np.sin(x[3]))
    out[:, 2], out[:, 3] = x[5] * turned[0] * edges[1], x[5] * edges[0] * turned[1]
    out[:, 4], out[:, 5] = 1.0, product
    out[:, 6], out[:, 7] = x[5] * blurred[0] * edges[1], x[5] * edges[0] * blurred[1]
    pattern, gradient = x[4] + x[5] * product, 1.0 + along @ x[8:]
    out[:, :8] *= gradient[:, None]
    out[:, 8:] = pattern[:, None] * along
    return pattern * gradient, out


def _spread(misfits: Array, which: Array) -> float:
    """Give the standard deviation of some residuals; of all where there are few."""
    chosen = misfits[which] if np.count_nonzero(which) >= 5 else misfits
    return float(np.sqrt(np.mean(chosen**2)))
