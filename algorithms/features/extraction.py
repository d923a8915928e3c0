"""From a scan to its lines, planes and cylinders."""

import math
from dataclasses import replace

import numpy as np

from algorithms.arrays import Indices, Matrices3, Vector3
from algorithms.features.cylinders.cylinder_axes import find_cylinders
from algorithms.features.options import FeatureOptions
from algorithms.features.planes.plane_boundaries import bound_planes
from algorithms.features.planes.plane_fitting import FittedPlanes, fit_planes, renumber
from algorithms.features.planes.plane_intersections import intersect_planes
from algorithms.features.planes.plane_points_kernels import unlabelled
from algorithms.features.planes.plane_segmentation import (
    UNEVENNESS_M,
    candidates_of,
    segment_planes,
    thickness,
    typical_noise,
)
from algorithms.features.scan_features import Rounding, ScanFeatures
from algorithms.features.surface_sample import sample_surface
from algorithms.geometry.lines import Lines, lines_from_arrays
from algorithms.geometry.planes import Planes
from algorithms.progress import Progress
from algorithms.scans.coordinate_steps import CoordinateSteps, coordinate_steps
from algorithms.scans.edge_on import planes_seen_edge_on
from algorithms.scans.grid_cells import grid_cells
from algorithms.scans.instrument_errors import sweep_of
from algorithms.scans.layered_cells import layered_cells
from algorithms.scans.mixed_pixels import angular_step, grid_ranges
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.range_image import spherical_range_image
from algorithms.scans.range_noise import range_noise
from algorithms.scans.scan import Scan, ScanGrid
from algorithms.scans.sensor_position import estimate_sensor_position
from algorithms.scans.surface_cells import CellSurfaces, SurfaceCells, cell_surfaces, orient, pool_cells, widened
from algorithms.scans.voxel_grid import voxel_cells, voxel_cells_of_fitting_size

LEAST_VOXEL_M = 0.08
"""Smallest voxel chosen by itself [m]."""
LEAST_WIDTH, TYPICAL_WIDTH = 0.45, 0.6
"""Least standard width of a single and of a typical neighbourhood, in voxels (a full square of three has 0.87)."""
FEW_CELLS = 300
"""Voxels do not grow beyond the size that leaves so few."""
MIN_CELLS = 6
"""Smallest plane in cells."""
WIDTH_IN_NOISE = 5.0
"""Least standard width of a neighbourhood of grid pixels, in standard deviations of the noise."""
FLAT_IN_NOISE = 2.0
"""Cells that grow although points are dense must be flat to so many standard deviations of the noise, and to the
unevenness of buildings."""
CAP_POINTS = 20.0
"""Largest weight of a voxel: near, dense voxels must not outweigh the rest of a plane."""
MOST_LEFT = 8_000_000
"""Cylinders are looked for among so many points at most: the only copy of coordinates stays small."""
DRAWN_POINTS = 80_000
"""Among so many points the instrument's position is looked for, as far as they lie on surfaces."""
SEEN_CELL_RAD = float(np.deg2rad(0.5))
"""Direction cells of the range image."""
GRID_LAG, GRID_STEPS = 8, 1.0
"""Grids are given up where coordinates are rounded to so many distances of their points, told from pixels so far apart.
"""
STEPS_PER_SEEN_CELL = 1.2
"""They are at least so many steps of a grid wide: in narrower ones nothing would be known of most directions."""


def extract_features(
    scan: Scan, options: FeatureOptions, *, progress: Progress, rng: np.random.Generator
) -> ScanFeatures:
    """Find planes, the lines where they meet, and cylinders of one scan.

    Parameters
    ----------
    scan
        One set-up.
    options
        Limits.
    progress
        Is told the steps: cells, planes, lines, cylinders, surface.
    rng
        Source of the random draws; the same state gives the same features.

    Raises
    ------
    InvalidInputError
        If the scan has no points or is too large for its point spacing.
    """
    progress.report(0.0, "cells")
    steps = coordinate_steps(scan)
    scan = _without_blurred_grid(scan, steps)
    cells, surfaces, noise = cut_into_cells(scan, options, steps.std_m)
    stood = sensor = scan.sensor_m
    sensor_std = None
    if sensor is None:
        drawn = _flat_points(cells, surfaces, rng)
        guess = estimate_sensor_position(
            scan.points[drawn], surfaces.normals[cells.cell_of_point[drawn]], candidate_m=-scan.origin_m, rng=rng
        )
        sensor, sensor_std = guess.position_m, guess.std_m
        # formats that name no instrument: what is seen from the origin of its file is in the instrument's axes
        stood = guess.position_m if guess.confirms_candidate else None
    surfaces = orient(cells, surfaces, sensor)
    noise = max(noise, typical_noise(cells, surfaces, sensor)) if options.point_std_m is None else options.point_std_m
    noise = max(noise, steps.std_m)  # points on one step do not scatter, and lie off it all the same
    sweep = sweep_of(replace(scan, sensor_m=stood))
    progress.report(0.3, "planes")
    regions = segment_planes(cells, surfaces, noise_std_m=noise, sensor_m=sensor, cap=CAP_POINTS, min_cells=MIN_CELLS)
    fitted, regions_fitted = fit_planes(
        scan.points, cells, candidates_of(cells, regions), regions.normals, regions.centroids,
        regions.noise_std_m, thickness_m=thickness(regions.noise_std_m), sensor_m=sensor,
        min_points=options.min_plane_points, steps=steps, sweep=sweep,
    )  # fmt: skip
    if sensor is not None:
        edge_on = planes_seen_edge_on(fitted.normals, fitted.centroids, fitted.bases, fitted.extents, sensor)
        real = np.flatnonzero(~edge_on)
        fitted, regions_fitted = fitted.select(real), regions_fitted[real]
    planes, rasters, kept = bound_planes(
        scan.points, fitted, cells, 0.25 * cells.size_m,
        min_area_m2=options.min_plane_area_m2, max_planes=options.max_planes,
    )  # fmt: skip
    progress.report(0.6, "lines")
    lines = intersect_planes(planes, rasters, min_length_m=options.min_line_length_m)
    progress.report(0.7, "cylinders")
    left = _left_over(cells, fitted.select(kept))
    cylinders = find_cylinders(scan.points[left], sensor, noise, options, steps)
    progress.report(0.9, "surface")
    cell_labels = renumber(regions.cell_labels, regions_fitted[kept])
    surface = sample_surface(scan.points, cells, surfaces, cell_labels, planes.normals, sensor)
    spacing = cells.size_m / float(np.sqrt(np.median(cells.counts)))
    splat = 0.0 if scan.grid is not None else 0.5 * spacing
    return ScanFeatures(
        lines=_joined(lines, cylinders.axes),
        planes=planes,
        cylinders=cylinders,
        surface=surface,
        seen=None
        if sensor is None
        else spherical_range_image(scan.points, sensor, _seen_cell_rad(scan, sensor), splat_m=splat),
        origin_m=scan.origin_m,
        sensor_m=sensor,
        point_count=len(scan),
        noise_std_m=_reported_noise(planes, noise, options),
        sensor_std_m=sensor_std,
        rounding=_rounding(steps, fitted.rounding_covariances[kept]),
        plane_responses=None if stood is None else fitted.responses[kept],
        sweep=sweep,
    )


def cut_into_cells(
    scan: Scan, options: FeatureOptions, least_noise_m: float = 0.0
) -> tuple[SurfaceCells, CellSurfaces, float]:
    """Cut a scan into cells, give each its tangent plane, and tell the noise that the ranges of a grid show [m].

    The cells of a grid are blocks of its pixels, those of a cloud voxels, which grow where its points are sparse.

    Parameters
    ----------
    scan, options
        The scan, and limits.
    least_noise_m
        What points lie off their surface by at least, though they may not scatter: rounded coordinates [m].
    """
    if scan.grid is not None:
        sensor: Vector3 = np.zeros(3) if scan.sensor_m is None else scan.sensor_m
        # all that follows takes three quarters of the time where neighbours in a row are neighbours in memory
        by_columns = scan.grid.is_recorded_by_columns
        grid = scan.grid.turned() if by_columns else scan.grid
        ranges = grid_ranges(scan.points, grid, sensor)
        cells = grid_cells(scan.points, grid, sensor, ranges)
        pooled = pool_cells(cells, cap=CAP_POINTS, min_count=6.0)
        noise = options.point_std_m
        if noise is None:
            of_ranges = range_noise(ranges.T if by_columns else ranges)
            noise = max(of_ranges, typical_noise(cells, pooled.surfaces, sensor), least_noise_m)
        return cells, widened(cells, pooled, WIDTH_IN_NOISE * noise), noise
    size = LEAST_VOXEL_M if options.voxel_size_m is None else options.voxel_size_m
    while True:
        if options.voxel_size_m is None:
            cells = voxel_cells_of_fitting_size(scan.points, least_size_m=size)
        else:
            cells = voxel_cells(scan.points, size)
        surfaces = cell_surfaces(cells, cap=CAP_POINTS, min_count=8.0, least_width_m=LEAST_WIDTH * cells.size_m)
        widths = surfaces.width_std_m[surfaces.width_std_m > 0]
        # scan lines far apart: typical neighbourhoods must be wide enough to hold several of them
        wide = len(widths) > 0 and float(np.median(widths)) > TYPICAL_WIDTH * cells.size_m
        if options.voxel_size_m is not None or wide or len(cells) < FEW_CELLS:
            noise = typical_noise(cells, surfaces, None) if options.point_std_m is None else options.point_std_m
            noise = max(noise, least_noise_m)
            flat_m = math.hypot(FLAT_IN_NOISE * noise, UNEVENNESS_M)
            return *layered_cells(cells, surfaces, largest_residual_m=flat_m), 0.0
        size = 1.25 * cells.size_m


def _without_blurred_grid(scan: Scan, steps: CoordinateSteps) -> Scan:
    """Take a scan for a mere cloud where its points are rounded to more than the distance of neighbours in its grid.

    There most neighbours are one point, and the next one is steps away: the grid says nothing of what is connected.
    """
    if scan.grid is None or scan.sensor_m is None or not steps.axes_m.any():
        return scan
    index = np.ascontiguousarray(scan.grid.index[::GRID_LAG, ::GRID_LAG])
    spacing_rad = angular_step(scan.points, ScanGrid(index), scan.sensor_m) / GRID_LAG
    few = scan.points[:: max(1, len(scan) // DRAWN_POINTS)]
    spacing = spacing_rad * float(np.median(np.linalg.norm(few - scan.sensor_m, axis=1)))
    if spacing == 0.0 or float(steps.axes_m.max()) < GRID_STEPS * spacing:
        return scan
    return replace(scan, grid=None)


def _flat_points(cells: SurfaceCells, surfaces: CellSurfaces, rng: np.random.Generator) -> Indices:
    """Draw points whose cells have a tangent plane, by rising number."""
    n = len(cells.cell_of_point)
    drawn = np.sort(rng.choice(n, size=min(n, DRAWN_POINTS), replace=False, shuffle=False))
    flat = np.isfinite(surfaces.residual_std_m)
    if cells.spread_m is not None:  # how surfaces hide each other is seen where points are dense
        flat &= cells.spread_m == 0.0
    flat = np.append(flat, False)  # the last stands for points without a cell
    return np.asarray(drawn[flat[cells.cell_of_point[drawn]]])


def _left_over(cells: SurfaceCells, planes: FittedPlanes) -> Indices:
    """List the points that lie on no plane, thinned evenly to `MOST_LEFT`."""
    labels, numbers, cell_of_point = planes.point_labels, planes.numbers, cells.cell_of_point
    parts = over_blocks(lambda start, end: unlabelled(labels, numbers, cell_of_point, start, end), len(labels))
    left: Indices = np.concatenate(parts)
    return left[:: max(1, math.ceil(len(left) / MOST_LEFT))]


def _seen_cell_rad(scan: Scan, sensor: Vector3) -> float:
    """Give how large the direction cells of the range image are [rad]."""
    if scan.grid is None:
        return SEEN_CELL_RAD
    return max(SEEN_CELL_RAD, STEPS_PER_SEEN_CELL * angular_step(scan.points, scan.grid, sensor))


def _reported_noise(planes: Planes, noise_std_m: float, options: FeatureOptions) -> float:
    """Give the noise of single points that was stated, else that of the planes, else that of the cells [m]."""
    if options.point_std_m is not None or len(planes) == 0:
        return noise_std_m
    return float(np.median(planes.noise_std_m))


def _rounding(steps: CoordinateSteps, plane_covariances: Matrices3) -> Rounding:
    """Keep what is known of the rounding of coordinates."""
    uneven = steps.uneven is not None and bool(steps.uneven.any())
    return Rounding(steps.axes_m, steps.range_m, uneven, steps.std_m, plane_covariances)


def _joined(first: Lines, second: Lines) -> Lines:
    """Put two sets of lines one after the other."""
    return lines_from_arrays(
        np.concatenate([first.anchors, second.anchors]),
        np.concatenate([first.directions, second.directions]),
        np.concatenate([first.covariances, second.covariances]),
        np.concatenate([first.extents, second.extents]),
        bases=np.concatenate([first.bases, second.bases]),
        sources=np.concatenate([first.sources, second.sources]),
        parents=np.concatenate([first.parents, second.parents]),
        parent_jacobians=np.concatenate([first.parent_jacobians, second.parent_jacobians]),
    )
