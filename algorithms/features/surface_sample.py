"""A scan thinned to one oriented point per voxel."""

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Labels
from algorithms.features.scan_features import SurfaceSample
from algorithms.scans.surface_cells import CellSurfaces, SurfaceCells
from algorithms.scans.voxel_grid import fullest_of_voxels

LARGEST_SAMPLE = 60_000
"""Points kept at most."""
LEAST_COUNT = 3.0
"""Cells of fewer points are no surface."""


def sample_surface(
    cells: SurfaceCells, surfaces: CellSurfaces, cell_labels: Labels, plane_normals: Float64[Array, "k 3"]
) -> SurfaceSample:
    """Keep one cell per voxel, with the normal of its plane where it has one.

    The voxels are as large as the cells, or larger until no more than `LARGEST_SAMPLE` are occupied; of the cells in
    one voxel the one of most points is kept.
    """
    used = np.flatnonzero((cell_labels >= 0) | (cells.counts >= LEAST_COUNT))
    size = cells.size_m
    if len(used) > LARGEST_SAMPLE:
        means, counts = np.ascontiguousarray(cells.means[used]), cells.counts[used]
        while True:
            size *= 1.25 if size > cells.size_m else max(1.0, (len(used) / LARGEST_SAMPLE) ** 0.5)
            fullest = fullest_of_voxels(means, size, counts)
            if len(fullest) <= LARGEST_SAMPLE:
                break
            size *= max(1.0, (len(fullest) / LARGEST_SAMPLE) ** 0.5 / 1.25)
        used = used[fullest]
    labels = cell_labels[used]
    normals = surfaces.normals[used]
    on_plane = labels >= 0
    normals[on_plane] = plane_normals[labels[on_plane]]
    return SurfaceSample(np.ascontiguousarray(cells.means[used]), normals, labels, size)
