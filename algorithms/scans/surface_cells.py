"""Small pieces of surface with their moments and neighbours: the common ground of structured and unstructured scans."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int32

from algorithms.arrays import Array, Labels, Points, Scalars, Vector3
from algorithms.scans import normals_kernels as kernels
from algorithms.scans.point_blocks import over_blocks

LEAST_CELLS = 1 << 13
"""Fewer cells are not worth a thread's while."""


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """m cells (voxels, or blocks of grid pixels) that partition the points of a scan."""

    cell_of_point: Labels
    """(n,) cell of each point, -1 for points left out."""
    moments: Float64[Array, "m 10"]
    """(m, 10) count, mean (3), central sums of products xx, xy, xz, yy, yz, zz."""
    neighbours: Int32[Array, "m k"]
    """(m, k) touching cells, -1 where there is none."""
    size_m: float
    """Typical distance of neighbouring cells [m]."""
    spread_m: Float64[Array, "m"] | None = None
    """(m,) half the width of cells that are larger than others because points are sparse there, 0 for others [m]; None:
    cells do not grow where points are sparse."""

    def __len__(self) -> int:
        return len(self.moments)

    @property
    def counts(self) -> Scalars:
        """(m,) points per cell."""
        return self.moments[:, 0]

    @property
    def means(self) -> Points:
        """(m, 3) centroids of the cells [m]."""
        return self.moments[:, 1:4]


@dataclass(frozen=True, eq=False)
class CellSurfaces:
    """The local tangent plane at each of m cells, from the moments of its neighbourhood."""

    normals: Points
    """(m, 3) unit normals, zero where no surface could be fitted."""
    residual_std_m: Scalars
    """(m,) standard deviation of points across the tangent plane [m], inf where there is none."""
    width_std_m: Scalars
    """(m,) standard deviation of points along the narrower direction of the neighbourhood [m]."""


@dataclass(frozen=True, eq=False)
class PooledCells:
    """m cells with the sums of their neighbourhoods and the tangent planes that these give."""

    moments: Float64[Array, "m 10"]
    """(m, 10) of every cell and its neighbours."""
    min_count: float
    """Least number of points in a neighbourhood."""
    surfaces: CellSurfaces


def pool_cells(cells: SurfaceCells, *, cap: float, min_count: float) -> PooledCells:
    """Add up the neighbourhood of every cell and fit tangent planes; see `cell_surfaces`."""
    m = len(cells)
    pooled = np.empty((m, 10))
    surfaces = CellSurfaces(np.empty((m, 3)), np.empty(m), np.empty(m))

    def work(start: int, end: int) -> None:
        kernels.pooled_surfaces(
            cells.moments, cells.neighbours, cap, min_count, start, end,
            pooled, surfaces.normals, surfaces.residual_std_m, surfaces.width_std_m,
        )  # fmt: skip

    over_blocks(work, m, least=LEAST_CELLS)
    return PooledCells(pooled, min_count, surfaces)


def widened(cells: SurfaceCells, pooled: PooledCells, wanted_width_m: float) -> CellSurfaces:
    """Fit tangent planes to wider neighbourhoods where they are narrower than wanted; changes those of `pooled`."""
    surfaces = pooled.surfaces
    narrow = (surfaces.width_std_m < wanted_width_m) & np.isfinite(surfaces.residual_std_m)

    def work(start: int, end: int) -> None:
        kernels.wider_surfaces(
            pooled.moments, cells.neighbours, narrow, pooled.min_count, start, end,
            surfaces.normals, surfaces.residual_std_m, surfaces.width_std_m,
        )  # fmt: skip

    over_blocks(work, len(cells), least=LEAST_CELLS)
    return surfaces


def cell_surfaces(
    cells: SurfaceCells, *, cap: float, min_count: float, wanted_width_m: float = 0.0, least_width_m: float = 0.0
) -> CellSurfaces:
    """Fit a tangent plane to the pooled neighbourhood of every cell; the sides of the normals are arbitrary.

    Parameters
    ----------
    cells
        The cells.
    cap
        Largest weight of one cell in points, so that near, dense cells do not dominate their neighbours.
    min_count
        Least (capped) number of points in a neighbourhood.
    wanted_width_m
        Neighbourhoods whose narrower standard deviation is below this are pooled once more: where points are closer
        together than their noise, a wider window is needed for a useful normal.
    least_width_m
        Neighbourhoods narrower than this are no surface: a single scan line across a wall does not tell its normal.
    """
    surfaces = widened(cells, pool_cells(cells, cap=cap, min_count=min_count), wanted_width_m)
    too_narrow = surfaces.width_std_m < least_width_m
    surfaces.normals[too_narrow] = 0.0
    surfaces.residual_std_m[too_narrow] = np.inf
    return surfaces


def orient(cells: SurfaceCells, surfaces: CellSurfaces, sensor_m: Vector3 | None) -> CellSurfaces:
    """Turn normals towards the sensor; without one they stay as they are."""
    if sensor_m is None:
        return surfaces
    normals = np.empty_like(surfaces.normals)

    def work(start: int, end: int) -> None:
        kernels.turn_normals(surfaces.normals, cells.moments, sensor_m, start, end, normals)

    over_blocks(work, len(cells), least=LEAST_CELLS)
    return replace(surfaces, normals=normals)
