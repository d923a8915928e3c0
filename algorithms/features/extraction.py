"""From a scan to its lines, planes and cylinders."""

import numpy as np

from algorithms.features.options import FeatureOptions
from algorithms.features.plane_boundaries import bound_planes
from algorithms.features.plane_fitting import fit_planes, renumber
from algorithms.features.plane_intersections import intersect_planes
from algorithms.features.plane_segmentation import candidates_of, segment_planes, typical_noise
from algorithms.features.scan_features import ScanFeatures, SurfaceSample
from algorithms.features.surface_sample import sample_surface
from algorithms.geometry.cylinders import Cylinders
from algorithms.geometry.lines import Lines
from algorithms.progress import Progress
from algorithms.scans.scan import Scan
from algorithms.scans.surface_cells import cell_surfaces
from algorithms.scans.voxel_grid import voxel_cells, voxel_cells_of_fitting_size

CAP_POINTS = 20.0
"""Largest weight of a voxel: near, dense voxels must not outweigh the rest of a plane."""


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
        Source of the random draws of the cylinder search; the same state gives the same features.

    Raises
    ------
    InvalidInputError
        If the scan has no points or is too large for its point spacing.
    """
    progress.report(0.0, "cells")
    sensor = scan.sensor_m
    cells = (
        voxel_cells_of_fitting_size(scan.points)
        if options.voxel_size_m is None
        else voxel_cells(scan.points, options.voxel_size_m)
    )
    surfaces = cell_surfaces(cells, sensor_m=sensor, cap=CAP_POINTS, min_count=8.0)
    progress.report(0.3, "planes")
    noise = typical_noise(surfaces)
    regions = segment_planes(cells, surfaces, noise_std_m=noise, cap=CAP_POINTS, min_cells=6)
    fitted, regions_fitted = fit_planes(
        scan.points, cells.cell_of_point, candidates_of(cells, regions), regions.normals, regions.centroids, noise,
        min_points=options.min_plane_points,
    )  # fmt: skip
    planes, rasters, kept = bound_planes(
        scan.points, fitted, 0.25 * cells.size_m,
        min_area_m2=options.min_plane_area_m2, max_planes=options.max_planes,
    )  # fmt: skip
    progress.report(0.6, "lines")
    lines = intersect_planes(planes, rasters, min_length_m=options.min_line_length_m)
    progress.report(0.9, "surface")
    surface = sample_surface(cells, surfaces, renumber(regions.cell_labels, regions_fitted[kept]), planes.normals)
    return ScanFeatures(
        lines=lines,
        planes=planes,
        cylinders=no_cylinders(),
        surface=surface,
        seen=None,
        origin_m=scan.origin_m,
        sensor_m=sensor,
        point_count=len(scan),
        noise_std_m=float(np.median(planes.noise_std_m)) if len(planes) else noise,
    )


def no_cylinders() -> Cylinders:
    """Give no cylinders."""
    none = np.empty(0)
    return Cylinders(Lines.empty(), none, none, np.empty(0, dtype=np.bool_), none, none, np.empty(0, dtype=np.int64))
