"""Block minimum: the lowest point of each window is ground, the others are not looked at."""

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.progress import Progress
from algorithms.terrain.cell_heights import cells_over, lowest_points
from algorithms.terrain.options import BlockMinimum


def block_min(points: Points, options: BlockMinimum, cell_m: float, progress: Progress) -> Flags:  # noqa: ARG001
    """Tell which points (n,) lie on the ground: those at most `tolerance_m` above the lowest of their window.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        The window.
    cell_m
        Not used.
    progress
        Not used.
    """
    grid = cells_over(points, options.window_m)
    cells = grid.cells_of(points)
    lowest = np.full(grid.rows * grid.columns, np.inf)
    numbers = lowest_points(points, grid)
    lowest[cells[numbers]] = points[numbers, 2]
    return np.asarray(points[:, 2] <= lowest[cells] + options.tolerance_m)
