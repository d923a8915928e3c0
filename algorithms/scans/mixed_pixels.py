"""Mixed pixels: points that hang in the air between a near edge and what lies behind it."""

import numpy as np
from jaxtyping import Bool, Float32

from algorithms.arrays import Array, Points, Vector3
from algorithms.scans import mixed_pixels_kernels as kernels
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.scan import ScanGrid

STEEPEST_RAD = float(np.deg2rad(83.0))
"""A surface met at a flatter angle than this is taken for a jump when it stands alone."""
LEAST_JUMP_M = 0.005
"""Jumps below the noise of instruments are none [m]."""


LINES = 16
"""Rows, and columns, from which the angular step is taken."""
LEAST_PIXELS = 1 << 16
"""Fewer pixels are not worth a block of rows of their own."""


def angular_step(points: Points, grid: ScanGrid, sensor_m: Vector3) -> float:
    """Give the larger of the median angles between neighbours in a column and in a row [rad]."""
    steps = []
    for index in (grid.index, np.ascontiguousarray(grid.index[:, :: max(1, grid.columns // LINES)].T)):
        lines = range(0, len(index), max(1, len(index) // LINES))
        tangents = np.concatenate([kernels.neighbour_tangents(points, index, sensor_m, line) for line in lines])
        if len(tangents):
            steps.append(float(np.arctan(np.median(tangents))))
    return max(steps, default=0.0)


def grid_ranges(points: Points, grid: ScanGrid, sensor_m: Vector3) -> Float32[Array, "rows columns"]:
    """Give the range of every pixel, 0 where nothing came back [m]."""
    out = np.empty(grid.index.shape, dtype=np.float32)

    def work(start: int, end: int) -> None:
        kernels.grid_ranges(points, grid.index, sensor_m, start, end, out)

    over_blocks(work, grid.rows, least=_rows_of(grid.columns))
    return out


def mixed_pixels(
    points: Points,
    grid: ScanGrid,
    sensor_m: Vector3,
    step_rad: float,
    ranges: Float32[Array, "rows columns"] | None = None,
) -> Bool[Array, "rows columns"]:
    """Mark the mixed pixels of a structured scan.

    A pixel is mixed when its range differs from both neighbours of its row, or of its column, by more than a surface
    met at `STEEPEST_RAD` would show, while beyond these neighbours the range goes on smoothly.

    Parameters
    ----------
    points, grid, sensor_m
        The scan and where the instrument stood [m].
    step_rad
        Angle between neighbouring pixels [rad].
    ranges
        What `grid_ranges` gives of the scan, if it is known already [m].
    """
    if ranges is None:
        ranges = grid_ranges(points, grid, sensor_m)
    out = np.empty(ranges.shape, dtype=np.bool_)
    slope = float(np.tan(STEEPEST_RAD))

    def work(start: int, end: int) -> None:
        kernels.torn_pixels(ranges, step_rad, slope, LEAST_JUMP_M, start, end, out)

    over_blocks(work, len(ranges), least=_rows_of(ranges.shape[1]))
    return out


def _rows_of(columns: int) -> int:
    """Give how many rows make a block worth while."""
    return max(1, LEAST_PIXELS // max(columns, 1))
