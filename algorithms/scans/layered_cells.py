"""Cells that grow where points are sparse: far away, or seen at a flat angle.

Voxels are as small as the typical distance of points allows, and say nothing where points are farther apart. But half
of what a scan shows, and most of what two far stations have in common, is far from the instrument. So voxels without
a tangent plane are united to larger ones, and what is still without to larger ones again, where these show flat
surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Array, Flags, Indices, Scalars
from algorithms.scans.cell_sums_kernels import summed_moments
from algorithms.scans.layered_cells_kernels import link_layer
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.surface_cells import CellSurfaces, SurfaceCells, cell_surfaces
from algorithms.scans.voxel_grid import voxel_cells
from algorithms.scans.voxel_grid_kernels import renumber

GROWTH, LEVELS = 2.0, 3
"""Each layer's cells are so much larger than those of the one below, and there are so many layers above the voxels."""
LEAST_POINTS, LEAST_WIDTH, CAP_POINTS = 8.0, 0.45, 20.0
"""Least number of points of a neighbourhood, its least standard width in cells, and the largest weight of a cell."""
FLATNESS = 0.2
"""Largest ratio of the deviations across and along a neighbourhood: large cells round edges and plants are none."""


@dataclass(frozen=True, eq=False)
class _Layer:
    """All voxels of a scan united to larger ones."""

    cells: SurfaceCells
    """`cell_of_point` tells the united cell of every voxel."""
    surfaces: CellSurfaces
    """Tangent planes of the united cells."""
    chosen: Flags
    """(m,) True for voxels that become part of a cell of this layer."""


def layered_cells(
    voxels: SurfaceCells, surfaces: CellSurfaces, *, largest_residual_m: float
) -> tuple[SurfaceCells, CellSurfaces]:
    """Unite voxels that have no tangent plane to larger cells that have one.

    O(m log m) for m voxels, and one pass over the points.

    Parameters
    ----------
    voxels, surfaces
        All voxels of a scan, and their tangent planes. `voxels.cell_of_point` is changed in place.
    largest_residual_m
        Where points are dense, voxels are united only if their points deviate less from a plane (standard deviation):
        around edges and on narrow frames they have no tangent plane either [m].

    Returns
    -------
    The voxels that stay, then the larger cells, which touch each other and the nearest voxels around them.
    """
    layers = _layers(voxels, surfaces, largest_residual_m)
    chosen = np.logical_or.reduce([layer.chosen for layer in layers])
    if not chosen.any():
        return replace(voxels, spread_m=np.zeros(len(voxels))), surfaces
    stays = np.flatnonzero(~chosen)
    numbers = np.empty(len(voxels), dtype=np.int32)
    numbers[stays] = np.arange(len(stays), dtype=np.int32)
    parents, starts, count = [], [], len(stays)
    for layer in layers:
        parent, number = np.unique(layer.cells.cell_of_point[layer.chosen], return_inverse=True)
        numbers[layer.chosen] = count + number
        parents.append(parent)
        starts.append(count)
        count += len(parent)
    moments = summed_moments(voxels.moments, numbers, count, np.inf, 0, len(voxels))
    neighbours = np.full((count, voxels.neighbours.shape[1]), -1, dtype=np.int32)
    touching = voxels.neighbours[stays]
    neighbours[: len(stays)] = np.where((touching >= 0) & ~chosen[touching], numbers[touching], -1)
    spread = np.zeros(count)
    listed = chosen | np.isfinite(surfaces.residual_std_m)
    for layer, parent, start in zip(layers, parents, starts, strict=True):
        united = layer.cells
        spread[start : start + len(parent)] = 0.5 * united.size_m
        link_layer(united.cell_of_point, numbers, listed, united.neighbours, parent, start, moments, neighbours)
    cell_of_point = voxels.cell_of_point
    over_blocks(lambda start, end: renumber(cell_of_point, numbers, start, end), len(cell_of_point))
    joined = _joined([(surfaces, stays), *zip((layer.surfaces for layer in layers), parents, strict=True)])
    return SurfaceCells(cell_of_point, moments, neighbours, voxels.size_m, spread), joined


def _layers(voxels: SurfaceCells, surfaces: CellSurfaces, largest_residual_m: float) -> list[_Layer]:
    """Unite voxels to larger and larger ones, and choose for each without a tangent plane the first that has one."""
    left = ~np.isfinite(surfaces.residual_std_m)
    crowded = np.zeros(len(voxels), dtype=np.bool_)
    crowded[left] = _points_around(voxels, np.flatnonzero(left)) >= LEAST_POINTS
    below, parent_of_voxel = voxels, np.arange(len(voxels), dtype=np.int32)
    layers = []
    for _ in range(LEVELS):
        united = voxel_cells(np.ascontiguousarray(below.means), GROWTH * below.size_m)
        parent_of_voxel = united.cell_of_point[parent_of_voxel]
        moments = summed_moments(below.moments, united.cell_of_point, len(united), np.inf, 0, len(below))
        cells = SurfaceCells(parent_of_voxel, moments, united.neighbours, united.size_m)
        found = cell_surfaces(cells, cap=CAP_POINTS, min_count=LEAST_POINTS, least_width_m=LEAST_WIDTH * cells.size_m)
        flat = found.residual_std_m < FLATNESS * found.width_std_m
        even = flat & (found.residual_std_m < largest_residual_m)
        layers.append(_Layer(cells, found, left & np.where(crowded, even[parent_of_voxel], flat[parent_of_voxel])))
        left &= ~layers[-1].chosen
        below = cells
    return layers


def _joined(parts: Sequence[tuple[CellSurfaces, Array]]) -> CellSurfaces:
    """Put some of the surfaces of several layers one after the other."""
    return CellSurfaces(
        np.concatenate([part.normals[which] for part, which in parts]),
        np.concatenate([part.residual_std_m[which] for part, which in parts]),
        np.concatenate([part.width_std_m[which] for part, which in parts]),
    )


def _points_around(voxels: SurfaceCells, which: Indices) -> Scalars:
    """Count the points of some voxels and all that touch them."""
    around = voxels.neighbours[which]
    counts = voxels.counts
    return np.asarray(counts[which] + np.where(around >= 0, counts[around], 0.0).sum(axis=1))
