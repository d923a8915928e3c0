"""Waves of place and attitude along a strip, a stochastic process in time whose size the data tell (MATH 12.4).

Satellites and inertial units leave errors that no polynomial over a whole strip follows. They are values at knots in
time with the covariance σ² (1 + a + a²/3) exp(−a), a = √5 d/τ, of knots d apart (Matérn 5/2), linear in between. σ of
shifts in plan, of heights and of tilts, and τ, maximise the marginal likelihood of all ties (Rasmussen & Williams 2006,
5.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy import linalg, optimize

from algorithms.arrays import Array, Matrix, Scalars

SPACING_S = 1.5
"""Wished distance of knots [s]."""
FEWEST_KNOTS = 3
MOST_KNOTS = 40
MOST_WAVES = 1200
"""Most unknowns of waves of a block."""
PER_KNOT = 6
GROUPS = (0, 0, 1, 2, 2, 2)
"""Which standard deviation shifts along x, y, z and roll, pitch, heading have."""
USUAL_SHIFT_M = 0.004
"""Usual standard deviation of waves of the place [m]."""
USUAL_TILT_RAD = 1.2e-5
"""Usual standard deviation of waves of the attitude [rad]."""
USUAL_S = 4.0
"""Usual correlation time [s]."""
LOG_SIZE = 1.0
"""Standard deviation of the logarithm of a size about the usual one, before data tell."""
LOG_TIME = 0.5
"""Standard deviation of the logarithm of the correlation time about the usual one, before data tell."""
RANGE = 5.0
"""Bounds of the search, in those standard deviations."""
NUGGET = 1e-6
"""Share of the variance that is added so that covariances are regular."""
MOST_STEPS = 25
TIME = 3
"""Number of the correlation time among the sizes."""


@dataclass(frozen=True, eq=False)
class Knots:
    """Times between which waves are linear."""

    times_s: Scalars
    """(k,) ascending, from the beginning to the end of a strip [s]."""

    def __len__(self) -> int:
        return len(self.times_s)

    def weights(self, times_s: Scalars) -> tuple[Array, Scalars]:
        """Return the number (n,) of the knot before each time, and the weight (n,) of the knot after it."""
        before = np.clip(np.searchsorted(self.times_s, times_s, side="right") - 1, 0, len(self) - 2)
        step = self.times_s[before + 1] - self.times_s[before]
        return before, np.clip((times_s - self.times_s[before]) / step, 0.0, 1.0)

    def interpolated(self, values: Float64[Array, "k 6"], times_s: Scalars) -> Float64[Array, "n 6"]:
        """Interpolate values at the knots."""
        before, after = self.weights(times_s)
        return np.asarray((1.0 - after)[:, None] * values[before] + after[:, None] * values[before + 1])

    def spread(self, fields: Float64[Array, "n 6"], times_s: Scalars) -> tuple[Array, Array]:
        """Return of each row the twelve unknowns (n, 12) of the knots around, and the derivatives (n, 12) by them."""
        before, after = self.weights(times_s)
        numbers = PER_KNOT * before[:, None] + np.arange(2 * PER_KNOT)
        return numbers, np.hstack([(1.0 - after)[:, None] * fields, after[:, None] * fields])


@dataclass(frozen=True)
class WaveSizes:
    """Standard deviations of waves, and their correlation time."""

    plan_m: float = USUAL_SHIFT_M
    height_m: float = USUAL_SHIFT_M
    tilt_rad: float = USUAL_TILT_RAD
    time_s: float = USUAL_S

    @staticmethod
    def of_logarithms(values: Float64[Array, "4"]) -> "WaveSizes":
        """Return sizes from logarithms of their ratios to the usual ones."""
        ratios = np.exp(values)
        return WaveSizes(*(float(a * b) for a, b in zip(ratios, _usual(), strict=True)))

    @property
    def logarithms(self) -> Float64[Array, "4"]:
        """Logarithms of the ratios to the usual ones."""
        return np.asarray(np.log(np.array([self.plan_m, self.height_m, self.tilt_rad, self.time_s]) / _usual()))

    def precisions(self, knots: Sequence[Knots]) -> list[Matrix]:
        """Return of each strip the inverse covariance of all its waves, those of a knot together."""
        found = []
        for each in knots:
            kernel, _ = self._kernel(each)
            inverse = linalg.inv(kernel)
            sizes = np.array([self.plan_m, self.height_m, self.tilt_rad])[list(GROUPS)]
            found.append(np.kron(0.5 * (inverse + inverse.T), np.diag(sizes**-2.0)))
        return found

    def _kernel(self, knots: Knots) -> tuple[Matrix, Matrix]:
        """Return correlations of knots and their derivatives by the logarithm of the correlation time."""
        apart = np.sqrt(5.0) * np.abs(knots.times_s[:, None] - knots.times_s) / self.time_s
        fall = np.exp(-apart)
        own = NUGGET * np.eye(len(knots))
        return (1.0 + apart + apart**2 / 3.0) * fall + own, apart**2 * (1.0 + apart) * fall / 3.0


def knots_of(spans_s: Sequence[tuple[float, float]]) -> list[Knots]:
    """Place knots along strips; none where a block has too many strips.

    Parameters
    ----------
    spans_s
        First and last time of each strip [s].
    """
    most = min(MOST_KNOTS, MOST_WAVES // (PER_KNOT * max(len(spans_s), 1)))
    if most < FEWEST_KNOTS:
        return []
    counts = [int(np.clip(np.ceil((last - first) / SPACING_S) + 1, FEWEST_KNOTS, most)) for first, last in spans_s]
    return [Knots(np.linspace(*span, count)) for span, count in zip(spans_s, counts, strict=True)]


def likeliest_sizes(start: WaveSizes, knots: Sequence[Knots], normal: Matrix, right: Float64[Array, "w"]) -> WaveSizes:
    """Estimate sizes of waves by the marginal likelihood of the data.

    With K = L Lᵀ the covariance of the waves and N w = b the normal equations of the data, all else eliminated, its
    logarithm is ½ |A^(−½) Lᵀ b|² − ½ log |A|, A = I + Lᵀ N L; the gradient by K is ½ K⁻¹ (w wᵀ + Q − K) K⁻¹.

    Parameters
    ----------
    start
        Where the search begins.
    knots
        Of each strip.
    normal, right
        Reduced normal equations of the waves, those of a knot together, strip by strip.
    """
    begins = PER_KNOT * np.concatenate([[0], np.cumsum([len(each) for each in knots])]).astype(np.int64)
    spread = np.array([LOG_SIZE, LOG_SIZE, LOG_SIZE, LOG_TIME])

    def cost(values: Float64[Array, "4"]) -> tuple[float, Float64[Array, "4"]]:
        sizes = WaveSizes.of_logarithms(values)
        stds = np.array([sizes.plan_m, sizes.height_m, sizes.tilt_rad])[list(GROUPS)]
        factor = np.zeros_like(normal)
        kernels = [sizes._kernel(each) for each in knots]  # noqa: SLF001 - its own module
        for first, last, (kernel, _) in zip(begins[:-1], begins[1:], kernels, strict=True):
            factor[first:last, first:last] = np.kron(np.linalg.cholesky(kernel), np.diag(stds))
        inner = np.eye(len(normal)) + factor.T @ normal @ factor
        lower = linalg.cholesky(inner, lower=True)
        scaled = linalg.solve_triangular(lower, factor.T @ right, lower=True)
        half = linalg.solve_triangular(lower, factor.T, lower=True)
        found, covariance = half.T @ scaled, half.T @ half
        value = (
            -0.5 * float(scaled @ scaled)
            + float(np.log(np.diag(lower)).sum())
            + 0.5 * float(((values / spread) ** 2).sum())
        )
        gradient = values / spread**2
        for first, last, (kernel, slope) in zip(begins[:-1], begins[1:], kernels, strict=True):
            inverse = linalg.inv(kernel)
            own, block = found[first:last].reshape(-1, PER_KNOT), covariance[first:last, first:last]
            block = block.reshape(len(kernel), PER_KNOT, len(kernel), PER_KNOT)
            for k, group in enumerate(GROUPS):
                whole = np.outer(own[:, k], own[:, k]) + block[:, k, :, k] - stds[k] ** 2 * kernel
                by_kernel = 0.5 * inverse @ whole @ inverse / stds[k] ** 2
                gradient[group] -= 2.0 * float((by_kernel * kernel).sum())
                gradient[TIME] -= float((by_kernel * slope).sum())
        return value, gradient

    bounds = [(-RANGE * each, RANGE * each) for each in spread]
    done = optimize.minimize(
        cost, start.logarithms, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": MOST_STEPS}
    )
    return WaveSizes.of_logarithms(done.x)


def _usual() -> Float64[Array, "4"]:
    return np.array([USUAL_SHIFT_M, USUAL_SHIFT_M, USUAL_TILT_RAD, USUAL_S])
