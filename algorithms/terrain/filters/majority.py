"""What most of three unlike filters call ground (after Podobnikar and Vrecko 2012, who choose the best by place)."""

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.progress import Progress, ProgressSection
from algorithms.terrain.filters.opening import opening
from algorithms.terrain.filters.quantile import quantile
from algorithms.terrain.filters.tin import tin
from algorithms.terrain.options import Majority, Opening, Quantile, Tin


def majority(points: Points, options: Majority, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground: those that two of three filters say so of.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        What the three have in common.
    cell_m
        Edge of the cells [m].
    progress
        Of the three.
    """
    window, tolerance = options.window_m, options.tolerance_m
    votes = np.zeros(len(points), dtype=np.int64)
    votes += opening(
        points, Opening(window_m=window, tolerance_m=tolerance), cell_m, ProgressSection(progress, 0.0, 0.2)
    )
    votes += tin(points, Tin(window_m=window, tolerance_m=tolerance), cell_m, ProgressSection(progress, 0.2, 0.9))
    votes += quantile(points, Quantile(tolerance_m=tolerance), cell_m, ProgressSection(progress, 0.9, 1.0))
    return np.asarray(votes >= 2)
