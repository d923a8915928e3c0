"""Voxels: points hashed into cubes, with a size that follows from the points themselves."""

import math

import numpy as np

from algorithms.arrays import Array, Points
from algorithms.errors import InvalidInputError
from algorithms.scans.surface_cells import SurfaceCells
from algorithms.scans.voxel_grid_kernels import BITS, bounds, centre_moments, hash_points, voxel_neighbours

POINTS_PER_VOXEL = 3.2
"""A voxel of 1.3 times the distance to the sixth neighbour holds that many points of a surface: 6 / pi * 1.3^2."""


def voxel_cells(points: Points, size_m: float) -> SurfaceCells:
    """Hash points into voxels.

    Raises
    ------
    InvalidInputError
        If the extent needs more than 2^20 voxels along one axis.
    """
    size, keys, table, moments, cell_of_point = _hash(points, size_m)
    return SurfaceCells(cell_of_point, moments, voxel_neighbours(keys, table), size)


def voxel_cells_of_fitting_size(points: Points, *, least_size_m: float = 0.08) -> SurfaceCells:
    """Hash points into voxels large enough that most of them hold several points.

    The size grows from `least_size_m` until the points at the 40 % quantile of density lie `POINTS_PER_VOXEL` together,
    which is about 1.3 times the distance to the sixth neighbour at the 60 % quantile.
    """
    extent = float(np.max(np.diff(_bounds(points), axis=0)))
    size = max(least_size_m, extent / (2**BITS - 4))
    while True:
        hashed = _hash(points, size)
        counts = np.sort(hashed[3][:, 0])
        weight = np.cumsum(counts)
        at_quantile = counts[np.searchsorted(weight, 0.4 * weight[-1])]
        if at_quantile >= POINTS_PER_VOXEL or size > extent:
            _, keys, table, moments, cell_of_point = hashed
            return SurfaceCells(cell_of_point, moments, voxel_neighbours(keys, table), size)
        size *= min(1.4, max(1.15, math.sqrt(POINTS_PER_VOXEL / at_quantile)))


def _bounds(points: Points) -> tuple[Array, Array]:
    """Give the smallest and largest coordinates, refusing an empty cloud."""
    if len(points) == 0:
        raise InvalidInputError("points", "there are none")
    return bounds(points)


def _hash(points: Points, size_m: float) -> tuple[float, Array, Array, Array, Array]:
    """Hash points and centre the moments: size, keys, table, moments, cell of each point."""
    low, high = _bounds(points)
    lower = low - 1.5 * size_m  # a free border keeps neighbour keys inside the bit fields
    if float(np.max(high - low)) / size_m > 2**BITS - 4:
        raise InvalidInputError("points", f"their extent needs more than {2**BITS} voxels of {size_m:.3g} m")
    cell_of_point, keys, table, moments = hash_points(points, lower, size_m)
    centre_moments(moments, keys, lower, size_m)
    return size_m, keys, table, moments, cell_of_point
