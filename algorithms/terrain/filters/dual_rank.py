"""The dual rank filter (Lohmann, Koch and Schaeffer 2000)."""

import numpy as np
from scipy.ndimage import rank_filter

from algorithms.arrays import Flags, Points
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, filled, lowest_heights
from algorithms.terrain.options import DualRank

MOST_ACROSS = 25
"""Cells of a window; with more, cells are made larger, for the work grows with their square."""


def dual_rank(points: Points, options: DualRank, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: near the lowest heights after two rank filters.

    Each height is replaced by the k-lowest in its window, then each by the k-highest.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Window and rank.
    cell_m
        Edge of the cells [m].
    """
    edge = max(cell_m, options.window_m / MOST_ACROSS)
    grid = cells_over(points, edge)
    across = max(3, round(options.window_m / edge)) | 1
    rank = min(round(options.rank_share * across**2), across**2 // 2)
    heights = filled(lowest_heights(points, grid))
    progress.report(0.1, "k-lowest heights")
    eroded = rank_filter(heights, rank, size=across, mode="nearest")
    progress.report(0.5, "k-highest heights")
    terrain = np.asarray(rank_filter(eroded, -1 - rank, size=across, mode="nearest"))
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)
