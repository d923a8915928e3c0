"""Standard deviations of heights on a grid: noise of the points, and what planes do not follow (MATH 11.5)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.ndimage import uniform_filter

from algorithms.arrays import Array

CellValues = Float64[Array, "rows columns"]
Moments = Float64[Array, "rows columns 10"]

REACHES = (40, 8, 2)
"""Cells to each side of the squares over which the misfit of planes is averaged; the first is wide enough to tell one
as small as the standard deviation of a plane from the noise."""
NEAR = 1
"""Cells to each side of the square whose points tell the noise."""
WIDE = 13
"""Cells to each side of the square that tells it where too few points are near."""
SURE = (1.0, 1.5, 1.5)
"""Standard deviations by which each average must differ from the wider one, the first from none at all, to count."""
PRIOR_FREEDOM = 20.0
"""Degrees of freedom that the noise of the wide square counts for where the points near by tell theirs."""
LEAST_FREEDOM = 5.0
"""Fewer within the cells of a wide square tell no noise: the residuals of the planes do."""
MOST_LEVERAGE = 0.95
"""A cell that determines its own plane further tells nothing of its misfit."""


@dataclass(frozen=True, eq=False)
class CellPlanes:
    """Planes through the points of each cell and its neighbours, from moments about the middles of cells."""

    moments: Moments
    """Of each cell alone: 1, u, v, z, uu, uv, vv, uz, vz, zz."""
    good: Bool[Array, "rows columns"]
    """Cells that have a plane."""
    count: CellValues
    """Points of a plane."""
    centre: tuple[CellValues, CellValues]
    """Mean place of the points of a plane, from the middle of the cell [cells]."""
    spread: tuple[CellValues, CellValues, CellValues]
    """Second moments of these places, uu, uv and vv about their mean."""
    heights: CellValues
    """In the middles of cells."""
    slopes: tuple[CellValues, CellValues]
    squares: CellValues
    """Sums of squared residuals."""

    def cofactor(self, u: CellValues | float, v: CellValues | float) -> CellValues:
        """Return the variance of the plane at a place of each cell, for points of variance 1."""
        (mu, mv), (cuu, cuv, cvv) = self.centre, self.spread
        per = 1.0 / np.where(self.good, cuu * cvv - cuv**2, 1.0)
        du, dv = u - mu, v - mv
        return np.asarray(1.0 / np.maximum(self.count, 1.0) + (cvv * du**2 - 2.0 * cuv * du * dv + cuu * dv**2) * per)


def plane_std(planes: CellPlanes) -> CellValues:
    """Return the standard deviations of the heights of planes in the middles of cells, NaN where there is no plane.

    σ² q + b²: σ² is the variance of single points, from the scatter within cells; b, the error of a plane where the
    surface bends or steps, is what the mean residuals of cells have beyond the noise. Both are averaged over squares of
    cells, wide ones and those near by.

    Parameters
    ----------
    planes
        Of all cells.
    """
    own = _OwnCells.of(planes)
    noise = _noise_variance(planes, own)
    misfit = _misfit_variance(own, noise)
    variance = noise * planes.cofactor(0.0, 0.0) + (1.0 - own.leverage) ** 2 * misfit
    return np.where(planes.good, np.sqrt(variance), np.nan)


@dataclass(frozen=True, eq=False)
class _OwnCells:
    """Points of single cells beside the plane through them and their neighbours."""

    count: CellValues
    """0 where there is no plane."""
    residual: CellValues
    """Mean height above the plane."""
    leverage: CellValues
    """Share of the cell's mean height in the plane's height there."""
    squares: CellValues
    """Sum of squares about that mean, along the plane."""

    @staticmethod
    def of(planes: CellPlanes) -> "_OwnCells":
        """Compare the points of each cell with its plane."""
        n, u, v, z, uu, uv, vv, uz, vz, zz = np.moveaxis(planes.moments, -1, 0)
        (b1, b2), count = planes.slopes, np.where(planes.good, n, 0.0)
        safe = np.maximum(n, 1.0)
        mu, mv, mz = u / safe, v / safe, z / safe
        cuz, cvz = uz - n * mu * mz, vz - n * mv * mz
        squares = (
            (zz - n * mz * mz) - 2.0 * (b1 * cuz + b2 * cvz) + b1**2 * (uu - n * mu * mu)
            + 2.0 * b1 * b2 * (uv - n * mu * mv) + b2**2 * (vv - n * mv * mv)
        )  # fmt: skip
        return _OwnCells(
            count=count,
            residual=np.where(count > 0.0, mz - planes.heights - b1 * mu - b2 * mv, 0.0),
            leverage=np.clip(count * planes.cofactor(mu, mv), 0.0, MOST_LEVERAGE),
            squares=np.where(count > 1.0, np.maximum(squares, 0.0), 0.0),
        )


def _noise_variance(planes: CellPlanes, own: _OwnCells) -> CellValues:
    """Return the variance of single points: of those near by, as far as they tell more than the wide square."""
    freedom, wide = np.maximum(own.count - 1.0, 0.0), WIDE
    within, of_planes = _summed(own.squares, wide), _summed(np.where(planes.good, planes.squares, 0.0), wide)
    known = _summed(freedom, wide)
    of_planes /= np.maximum(_summed(np.where(planes.good, planes.count - 3.0, 0.0), wide), 1.0)
    prior = np.where(known > LEAST_FREEDOM, within / np.maximum(known, 1.0), of_planes)
    near, known_near = _summed(own.squares, NEAR), _summed(freedom, NEAR)
    return np.asarray((PRIOR_FREEDOM * prior + near) / (PRIOR_FREEDOM + known_near))


def _misfit_variance(own: _OwnCells, noise: CellValues) -> CellValues:
    """Return the mean square by which the surface lies off planes that cells take no part in.

    The square of a cell's residual without the cell, less the part of noise, with weights of the points. A wide average
    holds where those near by do not differ from it for sure.
    """
    rest = 1.0 - own.leverage
    weights = own.count * rest
    expected = np.where(own.count > 0.0, noise / np.maximum(weights, 1e-12), 0.0)
    excess = (own.residual / rest) ** 2 - expected
    found = np.zeros_like(noise)
    for reach, sure in zip(REACHES, SURE, strict=True):
        total = np.maximum(_summed(weights, reach), 1e-12)
        mean = _summed(weights * excess, reach) / total
        std = np.sqrt(2.0 * _summed((weights * expected) ** 2, reach)) / total
        found = np.clip(found, np.maximum(mean - sure * std, 0.0), np.maximum(mean + sure * std, 0.0))
    return np.asarray(found)


def _summed(values: CellValues, reach: int) -> CellValues:
    """Sum values over squares of so many cells to each side."""
    side = 2 * reach + 1
    sums = np.asarray(uniform_filter(values, side, mode="constant")) * side**2
    # running sums leave rounding errors below zero
    return np.maximum(sums, 0.0) if (values >= 0.0).all() else sums
