"""A scan thinned to one oriented point per voxel."""

import numpy as np
from jaxtyping import Float64

from algorithms.arrays import Array, Labels, Vector3
from algorithms.features.scan_features import SurfaceSample
from algorithms.features.sparse_surface import LEAST_COUNT, is_dense, sparse_surface
from algorithms.scans.edge_on import seen_edge_on
from algorithms.scans.surface_cells import CellSurfaces, SurfaceCells
from algorithms.scans.surface_index import surface_owners
from algorithms.scans.voxel_grid import fullest_of_voxels

LARGEST_SAMPLE = 60_000
"""Points kept at most."""


def sample_surface(
    points: Float64[Array, "points 3"],
    cells: SurfaceCells,
    surfaces: CellSurfaces,
    cell_labels: Labels,
    plane_normals: Float64[Array, "k 3"],
    sensor_m: Vector3 | None,
) -> SurfaceSample:
    """Keep one cell per voxel, with the normal of its plane where it has one.

    The voxels are as large as the cells, or larger until no more than `LARGEST_SAMPLE` are occupied; of the cells in
    one voxel the one of most points is kept. Where points are sparse, cells are as large as it takes.

    Parameters
    ----------
    points
        (points, 3) the scan [m].
    cells, surfaces, cell_labels
        Its cells, their tangent planes (normals towards the sensor), and the plane each is on, -1 for none.
    plane_normals
        (k, 3) unit normals of the planes.
    sensor_m
        Where the instrument stood; None when unknown. What it would have seen edge-on (`edge_on`) gets no normal.
    """
    dense = is_dense(cells, surfaces, cell_labels)
    done = dense
    if cells.spread_m is not None:  # where few points made no surface in larger cells they are not tried again
        done = dense | (~np.isfinite(surfaces.residual_std_m) & (cells.counts < LEAST_COUNT))
    sparse = sparse_surface(points, cells, done, sensor_m)
    used = np.flatnonzero(dense | (cells.counts >= LEAST_COUNT))
    labels = cell_labels[used]
    normals = surfaces.normals[used]
    on_plane = labels >= 0
    normals[on_plane] = plane_normals[labels[on_plane]]
    means = np.concatenate([cells.means[used], sparse.points])
    normals = np.concatenate([normals, sparse.normals])
    labels = np.concatenate([labels, np.full(len(sparse.points), -1, dtype=labels.dtype)])
    if sensor_m is not None:  # curtains behind edges; planes were asked before as a whole, which tells better
        normals[(labels < 0) & seen_edge_on(means, normals, sensor_m)] = 0.0
    counts = np.concatenate([cells.counts[used], sparse.counts])
    size = cells.size_m
    kept: slice | Array = slice(None)
    if len(means) > LARGEST_SAMPLE:
        while True:
            size *= 1.25 if size > cells.size_m else max(1.0, (len(means) / LARGEST_SAMPLE) ** 0.5)
            kept = fullest_of_voxels(means, size, counts)
            if len(kept) <= LARGEST_SAMPLE:
                break
            size *= max(1.0, (len(kept) / LARGEST_SAMPLE) ** 0.5 / 1.25)
    means, normals = means[kept], normals[kept]
    return SurfaceSample(means, normals, labels[kept], size, surface_owners(means, normals, size))
