"""Mixed pixels: points that hang in the air between a near edge and what lies behind it."""

import numpy as np
from jaxtyping import Bool

from algorithms.arrays import Array, Points, Vector3
from algorithms.scans.mixed_pixels_kernels import grid_ranges, torn_pixels
from algorithms.scans.scan import ScanGrid

STEEPEST_RAD = float(np.deg2rad(83.0))
"""A surface met at a flatter angle than this is taken for a jump when it stands alone."""
LEAST_JUMP_M = 0.005
"""Jumps below the noise of instruments are none [m]."""


def angular_step(points: Points, grid: ScanGrid, sensor_m: Vector3) -> float:
    """Give the larger of the median angles between neighbours in a column and in a row [rad]."""
    steps = []
    for index in (grid.index, grid.index.T):
        lines = index[:: max(1, index.shape[0] // 64)]
        a, b = lines[:, :-1].ravel(), lines[:, 1:].ravel()
        both = (a >= 0) & (b >= 0)
        if both.any():
            u, v = points[a[both]] - sensor_m, points[b[both]] - sensor_m
            cross = np.linalg.norm(np.cross(u, v), axis=1)
            steps.append(float(np.median(np.arctan2(cross, np.einsum("ij,ij->i", u, v)))))
    return max(steps, default=0.0)


def mixed_pixels(points: Points, grid: ScanGrid, sensor_m: Vector3, step_rad: float) -> Bool[Array, "rows columns"]:
    """Mark the mixed pixels of a structured scan.

    A pixel is mixed when its range differs from both neighbours of its row, or of its column, by more than a surface
    met at `STEEPEST_RAD` would show, while beyond these neighbours the range goes on smoothly.
    """
    ranges = grid_ranges(points, grid.index, sensor_m)
    return torn_pixels(ranges, step_rad, float(np.tan(STEEPEST_RAD)), LEAST_JUMP_M)
