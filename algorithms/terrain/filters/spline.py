"""Bicubic splines with two regularisations (Brovelli, Cannata and Longoni 2002)."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from algorithms.arrays import Array, Flags, Points, Scalars
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, lowest_points
from algorithms.terrain.options import Spline

ROUNDS = 4
"""Fits of each regularisation; what stands above the last one takes no part in the next."""


def spline(points: Points, options: Spline, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: near a bicubic spline, a stiff one first, then a soft one.

    Points higher above a fit than `above_m` leave it, and the next fit is made without them.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Knots, regularisation and thresholds.
    cell_m
        Edge of the cells whose lowest points take part [m].
    progress
        Of the fits.
    """
    data = points[lowest_points(points, cells_over(points, cell_m))]
    knots = cells_over(points, options.knots_m)
    used = np.ones(len(data), dtype=np.bool_)
    basis = _basis(data, knots)
    fitted = np.zeros(basis.shape[1])
    for turn, stiffness in enumerate((options.stiff, options.soft)):
        for k in range(ROUNDS):
            progress.report((turn * ROUNDS + k) / (2.0 * ROUNDS), "fitting splines")
            fitted = _fit(basis[used], data[used, 2], knots, stiffness)
            above = data[:, 2] - basis @ fitted
            limit = options.above_m * (2.0 ** (ROUNDS - 1 - k) if turn == 0 else 1.0)
            renewed = above <= limit
            if (renewed == used).all() and k:
                break
            used = renewed
    grid = cells_over(points, cell_m)
    centres = np.column_stack([grid.centres(), np.zeros(grid.rows * grid.columns)])
    terrain: GridValues = (_basis(centres, knots) @ fitted).reshape(grid.shape)
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)


def _basis(points: Points, knots: Grid) -> sparse.csr_array:
    """Give the sixteen cubic B-splines that are not zero at each point, (n, knots)."""
    places = knots.places(points)
    column, row = np.floor(places).astype(np.int64).T
    column, row = np.clip(column, 0, knots.columns - 1), np.clip(row, 0, knots.rows - 1)
    along_u, along_v = _cubic(places[:, 0] - column), _cubic(places[:, 1] - row)
    values = along_v[:, :, None] * along_u[:, None, :]
    width = knots.columns + 3
    numbers = (row[:, None, None] + np.arange(4)[:, None]) * width + column[:, None, None] + np.arange(4)
    rows = np.repeat(np.arange(len(points)), 16)
    shape = (len(points), (knots.rows + 3) * width)
    return sparse.csr_array(sparse.coo_array((values.ravel(), (rows, numbers.ravel())), shape=shape))


def _cubic(t: Scalars) -> Array:
    """Give the four uniform cubic B-splines at places t in [0, 1] of an interval, (n, 4)."""
    return np.column_stack(
        [(1.0 - t) ** 3, 3.0 * t**3 - 6.0 * t**2 + 4.0, -3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0, t**3]
    ) / 6.0  # fmt: skip


def _fit(basis: sparse.csr_array, heights: Scalars, knots: Grid, stiffness: float) -> Array:
    """Minimise the squared residuals plus stiffness times the squared second differences of the coefficients."""
    rows, columns = knots.rows + 3, knots.columns + 3
    bend = [_second_differences(size) for size in (rows, columns)]
    eye = [sparse.eye_array(size) for size in (rows, columns)]
    smooth = sparse.kron(bend[0].T @ bend[0], eye[1]) + sparse.kron(eye[0], bend[1].T @ bend[1])
    mean = float(heights.mean())
    normal = sparse.csc_array(basis.T @ basis + stiffness * smooth + 1e-9 * sparse.eye_array(rows * columns))
    return np.asarray(splu(normal).solve(basis.T @ (heights - mean)) + mean)


def _second_differences(size: int) -> sparse.csr_array:
    return sparse.csr_array(sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(size - 2, size)))
