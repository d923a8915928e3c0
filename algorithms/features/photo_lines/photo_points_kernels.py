"""Compiled loops that bring the points of a scan into a photo."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def project(
    points: Array, rotation: Array, centre: Array, focal: Array, principal: Array, low: Array, high: Array, near: float
) -> tuple[Array, Array, Array]:
    """Find the points that fall into a rectangle of ideal pixels.

    `rotation` is camera from scan, `centre` the projection centre in scan coordinates. Returns the points' numbers,
    their ideal pixels and their depths, in the order of the points.
    """
    n = points.shape[0]
    room = 1024
    numbers = np.empty(room, dtype=np.int64)
    pixels = np.empty((room, 2))
    depths = np.empty(room)
    count = 0
    for i in range(n):
        dx = points[i, 0] - centre[0]
        dy = points[i, 1] - centre[1]
        dz = points[i, 2] - centre[2]
        z = rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz
        if z < near:
            continue
        u = focal[0] * (rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz) / z + principal[0]
        if u < low[0] or u >= high[0]:
            continue
        v = focal[1] * (rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz) / z + principal[1]
        if v < low[1] or v >= high[1]:
            continue
        if count == room:
            room *= 2
            more_numbers = np.empty(room, dtype=np.int64)
            more_numbers[:count] = numbers
            numbers = more_numbers
            more_pixels = np.empty((room, 2))
            more_pixels[:count] = pixels
            pixels = more_pixels
            more_depths = np.empty(room)
            more_depths[:count] = depths
            depths = more_depths
        numbers[count] = i
        pixels[count, 0] = u
        pixels[count, 1] = v
        depths[count] = z
        count += 1
    return numbers[:count], pixels[:count], depths[:count]


@njit(cache=True, nogil=True)
def sort_into_cells(pixels: Array, low: Array, cell_px: float, rows: int, columns: int) -> tuple[Array, Array]:
    """Sort pixels by the cell they lie in: their order, and where each cell (row by row) starts in it."""
    n = pixels.shape[0]
    cells = np.empty(n, dtype=np.int64)
    starts = np.zeros(rows * columns + 1, dtype=np.int64)
    for i in range(n):
        column = min(int((pixels[i, 0] - low[0]) / cell_px), columns - 1)
        row = min(int((pixels[i, 1] - low[1]) / cell_px), rows - 1)
        cells[i] = row * columns + column
        starts[cells[i] + 1] += 1
    for k in range(rows * columns):
        starts[k + 1] += starts[k]
    filled = starts[:-1].copy()
    order = np.empty(n, dtype=np.int64)
    for i in range(n):
        order[filled[cells[i]]] = i
        filled[cells[i]] += 1
    return order, starts


@njit(cache=True, nogil=True)
def not_hidden(depths: Array, starts: Array, tolerance: float, tolerance_m: float) -> Array:
    """Mark the points that no surface of their own cell hides.

    A surface is where the second nearest point of a cell is: a single point in front of everything hides nothing.
    """
    seen = np.ones(depths.shape[0], dtype=np.bool_)
    for cell in range(starts.shape[0] - 1):
        first, second = np.inf, np.inf
        for i in range(starts[cell], starts[cell + 1]):
            if depths[i] < first:
                first, second = depths[i], first
            elif depths[i] < second:
                second = depths[i]
        if second == np.inf:
            continue
        limit = second * (1.0 + tolerance) + tolerance_m
        for i in range(starts[cell], starts[cell + 1]):
            seen[i] = depths[i] <= limit
    return seen
