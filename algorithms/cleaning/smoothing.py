"""Smooth a cloud in passes, and say of each how far it moved the points."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Flags, Indices, Points
from algorithms.cleaning.options import Smoothing, SmoothingFilter
from algorithms.progress import Progress
from algorithms.scans.open3d_loading import import_open3d
from algorithms.scans.surface_cells import cell_surfaces
from algorithms.scans.voxel_grid import voxel_cells_of_fitting_size

MOST_NEIGHBOURS = 150
"""A neighbourhood holds no more points than this."""
OUTLIER_NEIGHBOURS = 20
"""From so many neighbours the mean distance of a point is taken."""
SPACINGS, NOISES = 4.0, 4.0
"""Without a radius, neighbourhoods reach over so many spacings of the points and standard deviations of their noise."""
TAUBIN_ITERATIONS = 10
LIKE_NORMALS = 0.3
"""Normals that differ by so much (of a unit vector) have 1/e^0.5 of the say in the bilateral filter."""
CAP_POINTS, LEAST_POINTS = 40.0, 8.0


@dataclass(frozen=True)
class SmoothingPass:
    """What one pass did."""

    largest_m: float
    """Largest movement of a point [m]."""
    mean_m: float
    """Mean movement [m]."""
    std_m: float
    """Standard deviation of the movements [m]."""
    removed: int
    """Points left out afterwards as outliers."""
    remaining: int
    """Points that are left."""


@dataclass(frozen=True, eq=False)
class SmoothedCloud:
    """The points that are left, where they are now, and what each pass did."""

    points: Points
    """(m, 3) moved points [m]."""
    numbers: Indices
    """(m,) which of the given points each one was."""
    passes: Sequence[SmoothingPass]


def smoothed(points: Points, options: Smoothing, progress: Progress) -> SmoothedCloud:
    """Smooth a cloud.

    Parameters
    ----------
    points
        (n, 3) near the origin [m].
    options
        Filter, passes, neighbourhood, outliers.
    progress
        Is told the passes.
    """
    radius = neighbourhood_m(points) if options.radius_m is None else options.radius_m
    numbers = np.arange(len(points))
    passes: list[SmoothingPass] = []
    for number in range(options.passes):
        progress.report(number / options.passes, f"smoothing, pass {number + 1}")
        moved = _filtered(points, options.filter, radius)
        movements = np.linalg.norm(moved - points, axis=1)
        kept = np.ones(len(moved), dtype=np.bool_)
        if options.outlier_std is not None:
            kept = _without_outliers(moved, options.outlier_std)
        points, numbers = moved[kept], numbers[kept]
        passes.append(
            SmoothingPass(
                float(movements.max()),
                float(movements.mean()),
                float(movements.std()),
                int(len(kept) - kept.sum()),
                int(kept.sum()),
            )
        )
    return SmoothedCloud(points, numbers, passes)


def neighbourhood_m(points: Points) -> float:
    """Give a radius that holds several neighbours and is wide compared with the noise across the surface [m]."""
    cells = voxel_cells_of_fitting_size(points, least_size_m=1e-4)
    surfaces = cell_surfaces(cells, cap=CAP_POINTS, min_count=LEAST_POINTS)
    known = np.isfinite(surfaces.residual_std_m)
    noise = float(np.median(surfaces.residual_std_m[known])) if known.any() else 0.0
    # a cell of fitting size is 1.3 times the distance to the sixth neighbour
    return max(SPACINGS * cells.size_m / (1.3 * math.sqrt(2.0)), NOISES * noise)


def _cloud(points: Points) -> Any:
    open3d = import_open3d()
    return open3d.t.geometry.PointCloud(open3d.core.Tensor(np.ascontiguousarray(points)))


def _filtered(points: Points, kind: SmoothingFilter, radius_m: float) -> Points:
    cloud = _cloud(points)
    if kind is SmoothingFilter.MLS:
        out = cloud.smooth_mls(radius=radius_m, max_nn=MOST_NEIGHBOURS)
    elif kind is SmoothingFilter.TAUBIN:
        out = cloud.smooth_taubin(iterations=TAUBIN_ITERATIONS)
    else:
        cloud.estimate_normals(max_nn=MOST_NEIGHBOURS, radius=radius_m)
        out = cloud.smooth_bilateral(
            radius=radius_m, max_nn=MOST_NEIGHBOURS, sigma_s=0.5 * radius_m, sigma_r=LIKE_NORMALS
        )
    return np.asarray(out.point.positions.numpy(), dtype=np.float64)


def _without_outliers(points: Points, std_ratio: float) -> Flags:
    """Tell which points are no outliers; all where there are too few to tell."""
    if len(points) <= OUTLIER_NEIGHBOURS:
        return np.ones(len(points), dtype=np.bool_)
    _, kept = _cloud(points).remove_statistical_outliers(nb_neighbors=OUTLIER_NEIGHBOURS, std_ratio=std_ratio)
    return np.asarray(kept.numpy(), dtype=np.bool_)
