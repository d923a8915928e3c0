"""Blocks of grid pixels: the cells of structured scans, whose neighbours follow from row and column."""

import math

import numpy as np

from algorithms.arrays import Points, Vector3
from algorithms.scans.grid_cells_kernels import block_moments, block_neighbours
from algorithms.scans.mixed_pixels import angular_step, mixed_pixels
from algorithms.scans.scan import ScanGrid
from algorithms.scans.surface_cells import SurfaceCells

MOST_CELLS = 800_000
"""Grids of more pixels are cut into larger blocks: single pixels of dense scans tell more about noise than surface."""
STEEPEST_RAD = float(np.deg2rad(80.0))
"""Blocks are neighbours on a surface that is met at no flatter angle than this."""
LEAST_JUMP_M = 0.01
"""Differences of range below this never part blocks [m]."""


def grid_cells(points: Points, grid: ScanGrid, sensor_m: Vector3) -> SurfaceCells:
    """Cut a structured scan into square blocks of pixels, without its mixed pixels.

    Blocks are single pixels for small scans and grow with the scan so that there are at most about `MOST_CELLS`.
    """
    step = angular_step(points, grid, sensor_m)
    mixed = mixed_pixels(points, grid, sensor_m, step)
    block = max(1, math.ceil(math.sqrt(grid.index.size / MOST_CELLS)))
    slope = math.tan(STEEPEST_RAD)
    cell_of_point, moments, cell_of_block = block_moments(
        points, grid.index, mixed, sensor_m, block, slope * step * block, LEAST_JUMP_M
    )
    neighbours, spacing = block_neighbours(moments, cell_of_block, sensor_m, block * step, slope, LEAST_JUMP_M)
    linked = spacing > 0
    return SurfaceCells(cell_of_point, moments, neighbours, float(np.median(spacing[linked])) if linked.any() else step)
