"""Voxels: points hashed into cubes, with a size that follows from the points themselves."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from algorithms.arrays import Array, Labels, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError
from algorithms.scans import voxel_grid_kernels as kernels
from algorithms.scans.point_blocks import blocks_of, over_blocks
from algorithms.scans.surface_cells import SurfaceCells
from algorithms.scans.voxel_grid_kernels import BITS

POINTS_PER_VOXEL = 3.2
"""A voxel of 1.3 times the distance to the sixth neighbour holds that many points of a surface: 6 / pi * 1.3^2."""


LEAST_GROWTH, MOST_GROWTH = 1.15, 1.4
"""Voxels that are too small grow by such factors."""
POINTS_PER_TABLE, MOST_TABLES = 1 << 19, 4
"""Fewer points are not worth a hash table of their own; all must be united, and kept until then."""
LEAST_CELLS = 1 << 13
"""Fewer voxels are not worth a thread's while."""
MOST_ALONG_AN_AXIS = 2**BITS - 4
"""So many voxels, with the free border around them, fit the bits of a key."""


def voxel_cells(points: Points, size_m: float) -> SurfaceCells:
    """Hash points into voxels.

    Raises
    ------
    InvalidInputError
        If the extent needs more than 2^20 voxels along one axis.
    """
    return _linked(hash_into_voxels(points, size_m))


def voxel_cells_of_fitting_size(points: Points, *, least_size_m: float = 0.08) -> SurfaceCells:
    """Hash points into voxels large enough that most of them hold several points.

    The size grows from `least_size_m` until the points at the 40 % quantile of density lie `POINTS_PER_VOXEL` together,
    which is about 1.3 times the distance to the sixth neighbour at the 60 % quantile.
    """
    extent = float(np.max(np.diff(_bounds(points), axis=0)))
    size = max(least_size_m, extent / (MOST_ALONG_AN_AXIS - 1))  # one to spare: a quotient of quotients is rounded
    few = len(points) < POINTS_PER_TABLE  # mostly sparse, so it takes several sizes: there counting is half the work
    while True:  # where the next size is likely to be the last, it is hashed at once
        hashed = None if few else hash_into_voxels(points, size)
        counts = np.sort(_counts(points, size) if hashed is None else hashed.moments[:, 0])
        weight = np.cumsum(counts)
        at_quantile = counts[np.searchsorted(weight, 0.4 * weight[-1])]
        if at_quantile >= POINTS_PER_VOXEL or size > extent:
            return _linked(hash_into_voxels(points, size) if hashed is None else hashed)
        growth = math.sqrt(POINTS_PER_VOXEL / at_quantile)
        few = few and growth > MOST_GROWTH
        size *= min(MOST_GROWTH, max(LEAST_GROWTH, growth))


def fullest_of_voxels(points: Points, size_m: float, counts: Scalars) -> Int64[Array, "voxels"]:
    """Pick the row of the largest count, of equals the first, from every voxel: (voxels,) in ascending order."""
    return np.sort(kernels.fullest(points, _lower(points, size_m), size_m, counts))


@dataclass(frozen=True, eq=False)
class HashedVoxels:
    """Points in voxels."""

    size_m: float
    lower_m: Vector3
    """(3,) corner from which voxels are counted [m]."""
    keys: Int64[Array, "m"]
    """(m,) voxels in ascending order."""
    moments: Float64[Array, "m 10"]
    """(m, 10) count, mean, central sums of products."""
    cell_of_point: Labels
    """(n,)."""


def _bounds(points: Points) -> tuple[Array, Array]:
    """Give the smallest and largest coordinates, refusing an empty cloud."""
    if len(points) == 0:
        raise InvalidInputError("points", "there are none")
    parts = over_blocks(lambda start, end: kernels.bounds(points, start, end), len(points))
    return np.min([low for low, _ in parts], axis=0), np.max([high for _, high in parts], axis=0)


def _lower(points: Points, size_m: float) -> Array:
    """Give the lower corner of the voxels, refusing too small ones."""
    low, high = _bounds(points)
    if float(np.max(high - low)) / size_m > MOST_ALONG_AN_AXIS:
        raise InvalidInputError("points", f"their extent needs more than {2**BITS} voxels of {size_m:.3g} m")
    return np.asarray(low - 1.5 * size_m)  # a free border keeps neighbour keys inside the bit fields


def _counts(points: Points, size_m: float) -> Int64[Array, "voxels"]:
    """Count the points of every voxel, (voxels,) in any order."""
    lower = _lower(points, size_m)
    halves = over_blocks(lambda half, _: kernels.count_points(points, lower, size_m, half), kernels.HALVES, least=1)
    return np.concatenate(halves)


def hash_into_voxels(points: Points, size_m: float) -> HashedVoxels:
    """Hash points into voxels numbered by their place, with their moments; O(n).

    Raises
    ------
    InvalidInputError
        Without points, or if the extent needs more than 2^20 voxels along one axis.
    """
    lower = _lower(points, size_m)
    cell_of_point = np.empty(len(points), dtype=np.int32)

    def work(start: int, end: int) -> tuple[Array, Array]:
        found: tuple[Array, Array] = kernels.hash_points(points, lower, size_m, start, end, cell_of_point)
        return found

    parts = over_blocks(work, len(points), least=POINTS_PER_TABLE, most=MOST_TABLES)
    starts = [start for start, _ in blocks_of(len(points), least=POINTS_PER_TABLE, most=MOST_TABLES)]
    keys, moments = np.empty(0, dtype=np.int64), np.empty((0, 10))
    numbers: dict[int, Array] = {}
    for start, part in zip(starts, parts, strict=True):
        keys, moments, numbers[start] = kernels.unite(keys, moments, *part)
    # numbered by place, neighbours are near each other in memory, and the order of the points does not matter
    order = np.argsort(keys)
    places = np.empty(len(order), dtype=np.int32)
    places[order] = np.arange(len(order), dtype=np.int32)
    keys, moments = keys[order], moments[order]
    over_blocks(
        lambda start, end: kernels.renumber(cell_of_point, places[numbers[start]], start, end),
        len(points), least=POINTS_PER_TABLE, most=MOST_TABLES,
    )  # fmt: skip
    kernels.centre_moments(moments, keys, lower, size_m)
    return HashedVoxels(size_m, lower, keys, moments, cell_of_point)


def _linked(hashed: HashedVoxels) -> SurfaceCells:
    """Find the touching voxels."""
    m = len(hashed.keys)
    table = kernels.table_of(hashed.keys, m, 1 << max(4 * m, 2).bit_length())
    neighbours = np.full((m, 26), -1, dtype=np.int32)
    over_blocks(
        lambda start, end: kernels.voxel_neighbours(hashed.keys, table, start, end, neighbours), m, least=LEAST_CELLS
    )
    return SurfaceCells(hashed.cell_of_point, hashed.moments, neighbours, hashed.size_m)
