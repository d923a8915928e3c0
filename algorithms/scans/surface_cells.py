"""Small pieces of surface with their moments and neighbours: the common ground of structured and unstructured scans."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64, Int32

from algorithms.arrays import Array, Labels, Points, Scalars, Vector3
from algorithms.scans.normals_kernels import pool_moments, surface_of_moments


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
    pooled = pool_moments(cells.moments, cells.neighbours, cap, np.ones(len(cells), dtype=np.bool_))
    normals, residual, width = surface_of_moments(pooled, min_count)
    narrow = (width < wanted_width_m) & np.isfinite(residual)
    if narrow.any():
        wider = pool_moments(pooled, cells.neighbours, np.inf, narrow)
        which = np.flatnonzero(narrow)
        normals[which], residual[which], width[which] = surface_of_moments(wider[which], min_count)
    too_narrow = width < least_width_m
    normals[too_narrow] = 0.0
    residual[too_narrow] = np.inf
    return CellSurfaces(normals, residual, width)


def orient(cells: SurfaceCells, surfaces: CellSurfaces, sensor_m: Vector3 | None) -> CellSurfaces:
    """Turn normals towards the sensor; without one they stay as they are."""
    if sensor_m is None:
        return surfaces
    away = np.einsum("ij,ij->i", surfaces.normals, cells.means - sensor_m) > 0
    return replace(surfaces, normals=np.where(away[:, None], -surfaces.normals, surfaces.normals))
