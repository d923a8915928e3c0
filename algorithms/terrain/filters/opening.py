"""Openings by growing windows (Kilian, Haala and Englich 1996; thresholds after Pingel, Clarke and McBride 2013)."""

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import GridFlags, cells_over, filled, lowest_heights
from algorithms.terrain.morphology import disc_opening
from algorithms.terrain.options import Opening
from algorithms.terrain.segments import standing_objects


def opening(points: Points, options: Opening, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground.

    The lowest heights of cells are opened by discs of growing radius. A cell that an opening lowers by more than
    `slope` · radius is an object, unless its segment goes on smoothly into the terrain; the others carry the terrain,
    and points near it are ground.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Windows and thresholds.
    cell_m
        Edge of the cells [m].
    """
    grid = cells_over(points, cell_m)
    terrain = opened_terrain(points, grid, options.window_m, options.slope, progress)
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)


def opened_terrain(points: Points, grid: Grid, window_m: float, slope: float, progress: Progress) -> GridValues:
    """Give the heights of the terrain (rows, columns) [m]: the lowest points, filled where openings see objects."""
    lowest = lowest_heights(points, grid)
    objects = object_cells(filled(lowest), grid, window_m, slope, progress)
    return filled(np.where(objects, np.nan, lowest))


def object_cells(heights: GridValues, grid: Grid, window_m: float, slope: float, progress: Progress) -> GridFlags:
    """Tell which cells (rows, columns) growing openings lower by more than slope · radius, but for edges of terrain."""
    offset = float(heights.mean())
    surface = (heights - offset).astype(np.float32)
    objects = np.zeros(grid.shape, dtype=np.bool_)
    largest = max(1, round(window_m / grid.cell_m))
    for radius in range(1, largest + 1):
        progress.report(radius / (largest + 1), f"opening by {radius * grid.cell_m:.0f} m")
        opened = disc_opening(surface, radius)
        objects |= surface - opened > slope * radius * grid.cell_m
        surface = opened
    return standing_objects(objects, heights)
