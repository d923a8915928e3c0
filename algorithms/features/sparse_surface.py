"""Surface that no cell of a scan shows by itself: far away, seen at a flat angle, or rough.

Cells of clouds grow where points are sparse (`layered_cells`), those of grids do not, and neither shows what is no
plane. But what two far stations have in common is mostly far from both. Points left there are cut into larger voxels,
and what is still left into larger ones again, as long as they show flat surface.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Indices, Labels, Points, Scalars, Vector3
from algorithms.scans.layered_cells import CAP_POINTS, FLATNESS, GROWTH, LEAST_POINTS, LEAST_WIDTH, LEVELS
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_cells import CellSurfaces, SurfaceCells, cell_surfaces, orient
from algorithms.scans.voxel_grid import voxel_cells

LEAST_COUNT = 3.0
"""Cells of fewer points are sparse."""


@dataclass(frozen=True, eq=False)
class SparseSurface:
    """s pieces of surface of which few points are known."""

    points: Points
    """(s, 3) means of their points [m]."""
    normals: Points
    """(s, 3) unit normals, towards the sensor."""
    counts: Scalars
    """(s,) their points."""


def is_dense(cells: SurfaceCells, surfaces: CellSurfaces, cell_labels: Labels) -> Array:
    """Say which of the (m,) cells are surface by themselves: on a plane, or with a normal and a few points."""
    with_normal = np.einsum("ij,ij->i", surfaces.normals, surfaces.normals) > 0.5
    dense = (cell_labels >= 0) | (with_normal & (cells.counts >= LEAST_COUNT))
    return np.asarray(dense if cells.spread_m is None else dense | (cells.spread_m > 0.0))


def sparse_surface(
    points: Float64[Array, "points 3"], cells: SurfaceCells, done: Array, sensor_m: Vector3 | None
) -> SparseSurface:
    """Find flat surface in the points whose cells are too small to show it.

    Parameters
    ----------
    points
        (points, 3) the scan [m].
    cells
        Its cells.
    done
        (m,) bool: the cells that are surface by themselves, or surely none.
    sensor_m
        Where the instrument stood; without it the sides of the normals are arbitrary.
    """
    found = [SparseSurface(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))]

    def sparse(start: int, end: int) -> Indices:
        cell = cells.cell_of_point[start:end]
        return start + np.flatnonzero((cell >= 0) & ~done[cell])

    parts = over_blocks(sparse, len(points))
    left = points[np.concatenate(parts)]
    size = cells.size_m
    for _ in range(LEVELS):
        size *= GROWTH
        if len(left) < LEAST_POINTS:
            break
        voxels = voxel_cells(left, size)
        pieces = cell_surfaces(voxels, cap=CAP_POINTS, min_count=LEAST_POINTS, least_width_m=LEAST_WIDTH * size)
        pieces = orient(voxels, pieces, sensor_m)
        flat = pieces.residual_std_m < FLATNESS * pieces.width_std_m
        found.append(SparseSurface(voxels.means[flat], pieces.normals[flat], voxels.counts[flat]))
        left = left[~flat[voxels.cell_of_point]]
    return SparseSurface(
        np.concatenate([each.points for each in found]),
        np.concatenate([each.normals for each in found]),
        np.concatenate([each.counts for each in found]),
    )
