"""Blocks of grid pixels: the cells of structured scans, whose neighbours follow from row and column."""

import math

import numpy as np
from jaxtyping import Float32

from algorithms.arrays import Array, Points, Vector3
from algorithms.scans import grid_cells_kernels as kernels
from algorithms.scans.mixed_pixels import angular_step, grid_ranges, mixed_pixels
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.scan import ScanGrid
from algorithms.scans.surface_cells import SurfaceCells

MOST_CELLS = 800_000
"""Grids of more pixels are cut into larger blocks: single pixels of dense scans tell more about noise than surface."""
STEEPEST_RAD = float(np.deg2rad(80.0))
"""Blocks are neighbours on a surface that is met at no flatter angle than this."""
ENOUGH = 50_000
"""A median needs no more than the distances of about so many blocks."""
LEAST_JUMP_M = 0.01
"""Differences of range below this never part blocks [m]."""


LEAST_BLOCKS = 1 << 13
"""Fewer blocks are not worth a thread's while."""


def grid_cells(
    points: Points, grid: ScanGrid, sensor_m: Vector3, ranges: Float32[Array, "rows columns"] | None = None
) -> SurfaceCells:
    """Cut a structured scan into square blocks of pixels, without its mixed pixels.

    Blocks are single pixels for small scans and grow with the scan so that there are at most about `MOST_CELLS`.

    Parameters
    ----------
    points, grid, sensor_m
        The scan and where the instrument stood [m].
    ranges
        What `grid_ranges` gives of them, if it is known already [m].
    """
    step = angular_step(points, grid, sensor_m)
    if ranges is None:
        ranges = grid_ranges(points, grid, sensor_m)
    mixed = mixed_pixels(points, grid, sensor_m, step, ranges)
    block = max(1, math.ceil(math.sqrt(grid.index.size / MOST_CELLS)))
    slope = math.tan(STEEPEST_RAD)
    shape = (-(-grid.rows // block), -(-grid.columns // block))
    least = max(1, LEAST_BLOCKS // max(shape[1], 1))
    cell_of_block = np.empty(shape, dtype=np.int32)
    over_blocks(
        lambda start, end: kernels.occupied_blocks(grid.index, mixed, block, start, end, cell_of_block),
        len(cell_of_block), least=least,
    )  # fmt: skip
    count = int(kernels.number_blocks(cell_of_block))
    cell_of_point = np.empty(len(points), dtype=np.int32)
    over_blocks(lambda start, end: cell_of_point[start:end].fill(-1), len(points))
    moments = np.empty((count, 10))
    neighbours = np.empty((count, 8), dtype=np.int32)
    spacing = np.empty(count)

    def add_up(start: int, end: int) -> None:
        kernels.block_moments(
            points, grid.index, mixed, ranges, cell_of_block, block, slope * step * block, LEAST_JUMP_M,
            start, end, cell_of_point, moments,
        )  # fmt: skip

    def link(start: int, end: int) -> None:
        kernels.block_neighbours(
            moments, cell_of_block, sensor_m, block * step, slope, LEAST_JUMP_M, start, end, neighbours, spacing
        )

    over_blocks(add_up, len(cell_of_block), least=least)
    over_blocks(link, len(cell_of_block), least=least)
    spacing = spacing[:: max(1, count // ENOUGH)]
    linked = spacing > 0
    return SurfaceCells(cell_of_point, moments, neighbours, float(np.median(spacing[linked])) if linked.any() else step)
