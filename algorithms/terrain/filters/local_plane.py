"""Planes in windows, in which the lowest points weigh most (Roggero 2001)."""

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import minimum_filter, uniform_filter

from algorithms.arrays import Array, Flags, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, lowest_heights
from algorithms.terrain.options import LocalPlane


def local_plane(points: Points, options: LocalPlane, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: near weighted planes, in large windows, then in smaller ones.

    A cell's weight falls with its height above the lowest of its window. After the first pass cells far above their
    planes take no part any more.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Windows and thresholds.
    cell_m
        Edge of the cells [m].
    progress
        Of the passes.
    """
    grid = cells_over(points, cell_m)
    lowest = lowest_heights(points, grid)
    for turn, share in enumerate((1.0, options.second_share)):
        progress.report(turn / 2.0, "planes in windows")
        across = max(3, round(share * options.window_m / cell_m)) | 1
        planes = _weighted_planes(filled(lowest), across, options.height_m, grid)
        lowest = np.where(lowest - planes > share * options.height_m, np.nan, lowest)
    return within_band(points, filled(lowest), grid, options.tolerance_m, options.per_slope_m)


def _weighted_planes(heights: GridValues, across: int, height_m: float, grid: Grid) -> GridValues:
    """Give the height of the plane through each window in its middle.

    Weights are 1 / (1 + (h / height)²) by the height h above the lowest of the window.
    """
    base = float(heights.mean())
    z = heights - base
    above = z - minimum_filter(z, size=across, mode="nearest")
    w = 1.0 / (1.0 + (above / height_m) ** 2)
    v, u = np.indices(grid.shape, dtype=np.float64)
    u, v = u - u.mean(), v - v.mean()
    n, mu, mv, mz = (_mean(w * each, across) for each in (1.0, u, v, z))
    mu, mv, mz = mu / n, mv / n, mz / n
    cuu, cuv, cvv = (_mean(w * each, across) / n for each in (u * u, u * v, v * v))
    cuz, cvz = (_mean(w * each, across) / n for each in (u * z, v * z))
    cuu, cuv, cvv = cuu - mu * mu, cuv - mu * mv, cvv - mv * mv
    cuz, cvz = cuz - mu * mz, cvz - mv * mz
    determinant = cuu * cvv - cuv**2
    good = determinant > 1e-3 * (0.5 * (cuu + cvv)) ** 2
    per = np.where(good, 1.0 / np.where(good, determinant, 1.0), 0.0)
    b1, b2 = (cvv * cuz - cuv * cvz) * per, (cuu * cvz - cuv * cuz) * per
    return np.asarray(mz + b1 * (u - mu) + b2 * (v - mv) + base)


def _mean(values: Float64[Array, "rows columns"], across: int) -> Float64[Array, "rows columns"]:
    return np.asarray(uniform_filter(values, size=across, mode="nearest"))
