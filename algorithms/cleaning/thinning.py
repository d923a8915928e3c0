"""Thin a cloud: evenly, or less where the surface bends. What is kept was measured; nothing is averaged."""

import numpy as np

from algorithms.arrays import Flags, Points, Scalars
from algorithms.scans.surface_cells import cell_surfaces, pool_cells
from algorithms.scans.voxel_grid import fullest_of_voxels, voxel_cells, voxel_cells_of_fitting_size

EVEN_PART = 1.0 / 3.0
"""Of the points that are kept about so many cover the surface evenly, however flat it is."""
SIZES = 24
"""Cubes are made larger in steps until the even part is small enough."""
STEP = 1.25
CAP_POINTS, LEAST_POINTS = 40.0, 8.0
"""Largest weight of a cell among its neighbours, and least number of points that tell a curvature."""


def voxel_thinned(points: Points, voxel_m: float) -> Flags:
    """Keep in every cube the measured point nearest to the mean of its points; (n,) True for points to keep."""
    cells = voxel_cells(points, voxel_m)
    off = points - cells.means[cells.cell_of_point]
    nearness = -np.einsum("ij,ij->i", off, off)
    kept = np.zeros(len(points), dtype=np.bool_)
    kept[fullest_of_voxels(points, voxel_m, nearness)] = True
    return kept


def curvature_thinned(points: Points, share: float) -> Flags:
    """Keep a share of the points: a third of them evenly spread, the others where the surface bends most.

    The bend is the surface variation of M. Pauly, M. Gross, L. Kobbelt, Efficient simplification of point-sampled
    surfaces (2002): the smallest eigenvalue of the scatter of a neighbourhood over the sum of all three.

    Parameters
    ----------
    points
        (n, 3), smoothed: noise bends too [m].
    share
        Of the points to keep.

    Returns
    -------
    (n,) True for points to keep; their number is the share rounded, but never fewer than the even part needs.
    """
    wanted = max(1, round(share * len(points)))
    if wanted >= len(points):
        return np.ones(len(points), dtype=np.bool_)
    kept = _even_part(points, max(1, round(EVEN_PART * wanted)))
    left = np.flatnonzero(~kept)
    bends = surface_variations(points)[left]
    chosen = left[np.argsort(-bends, kind="stable")[: max(0, wanted - int(kept.sum()))]]
    kept[chosen] = True
    return kept


def surface_variations(points: Points) -> Scalars:
    """Give the surface variation around each point, (n,): 0 is flat, 1/3 has no surface."""
    cells = voxel_cells_of_fitting_size(points, least_size_m=1e-4)
    surfaces = cell_surfaces(cells, cap=CAP_POINTS, min_count=LEAST_POINTS)
    pooled = pool_cells(cells, cap=CAP_POINTS, min_count=LEAST_POINTS)
    counts = np.maximum(pooled.moments[:, 0], 1.0)
    total = (pooled.moments[:, 4] + pooled.moments[:, 7] + pooled.moments[:, 9]) / counts
    known = np.isfinite(surfaces.residual_std_m) & (total > 0.0)
    variation = np.where(known, np.where(known, surfaces.residual_std_m, 0.0) ** 2 / np.where(known, total, 1.0), 0.0)
    return np.asarray(np.minimum(variation, 1.0 / 3.0)[cells.cell_of_point])


def _even_part(points: Points, wanted: int) -> Flags:
    """Keep at most about so many points, evenly spread."""
    extent = np.ptp(points, axis=0)
    size = max(float(np.sqrt(np.sort(extent)[1] * extent.max() / max(wanted, 1))), float(extent.max()) / 1e5, 1e-6)
    size /= STEP ** (SIZES // 2)
    size = max(size, float(extent.max()) / 5e5)
    kept = voxel_thinned(points, size)
    for _ in range(SIZES):
        if int(kept.sum()) <= wanted:
            break
        size *= STEP * max(1.0, float(np.sqrt(kept.sum() / wanted)) / STEP)
        kept = voxel_thinned(points, size)
    return kept
