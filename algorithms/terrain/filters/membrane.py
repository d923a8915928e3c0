"""An elastic membrane that is drawn up to the points from below (Elmqvist 2001)."""

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.deviations.rasters import GridValues
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, lowest_heights
from algorithms.terrain.cell_heights_kernels import raise_membrane
from algorithms.terrain.options import Membrane

SWEEPS, OVER_RELAXATION = 80, 1.7
"""At each level; coarser levels have moved the membrane near its place before."""
COARSEST = 8
"""Cells along the shorter side of the coarsest level."""


def membrane(points: Points, options: Membrane, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: near a membrane below the lowest heights.

    A force draws the membrane up, its stiffness holds it back where points stand out, and no cell rises above its
    lowest point. Between supports at a distance d it rises by `lift_per_m` · d² / 8.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        The ratio of force to stiffness, and the band.
    cell_m
        Edge of the cells [m].
    progress
        Of the levels.
    """
    grid = cells_over(points, cell_m)
    ceiling = filled(lowest_heights(points, grid))
    progress.report(0.2, "raising the membrane")
    surface = _raised(ceiling, options.lift_per_m * cell_m**2)
    return within_band(points, surface, grid, options.tolerance_m, options.per_slope_m)


def _raised(ceiling: GridValues, lift: float) -> GridValues:
    rows, columns = ceiling.shape
    if min(rows, columns) <= COARSEST:
        surface = np.full(ceiling.shape, float(ceiling.min()))
    else:
        pad = ((0, rows % 2), (0, columns % 2))
        padded = np.pad(ceiling, pad, mode="edge")
        # the mean of lowest points would let the membrane through; their least holds it
        coarse = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2).min(axis=(1, 3))
        below = _raised(coarse, 4.0 * lift)
        surface = np.minimum(below.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns], ceiling)
    raise_membrane(surface, ceiling, lift, SWEEPS, OVER_RELAXATION)
    return surface
