"""The raster part of `compare`: difference of two surfaces, its pattern, and maps of what each surface is worth."""

from dataclasses import replace

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Points, Vector3
from algorithms.deviations import colour_classes as colours
from algorithms.deviations.options import RasterOptions
from algorithms.deviations.rasters import Grid, GridValues, grid_over, raster_surface, viewed_along, wished_cell
from algorithms.deviations.surface_maps import density_map, distance_map, residuals_of, rms_map
from algorithms.deviations.surface_patterns import surface_pattern
from schemas.results.deviations_result import PatternFigures
from service.formats.writers.grid_files import Files, GridFrame, grid_files
from service.ports import Json
from service.use_cases.reports.grid_pictures import grid_png

POINTS_PER_CELL = 4.0
CLASSES_IN_METRES = 0.5
"""First class of the source's distance map; others scale with the cell."""
SEEN_FROM_ABOVE = 1.0 - 1e-9
"""Least cosine between the view and the vertical of a grid whose axes are those of the world."""


def compared_surfaces(
    reference: Points,
    cloud: Points,
    options: Json,
    view: Vector3,
    origin_m: Vector3,
    crs_wkt: str | None = None,
) -> tuple[PatternFigures, Files]:
    """Compare two clouds as surfaces on a grid seen from a side.

    Parameters
    ----------
    reference, cloud
        (n, 3), (m, 3) in the world, reduced [m].
    options
        Of the raster, as requested.
    view
        Direction towards the observer.
    origin_m
        What was subtracted from the coordinates [m].
    crs_wkt
        Coordinate reference system of the world; None: not known. Grids seen from aside have none.
    """
    wanted = TypeAdapter(RasterOptions).validate_python(options)
    first, second = viewed_along(reference, view), viewed_along(cloud, view)
    corner = viewed_along(origin_m[None], view)[0]
    cell = wanted.cell_m or _cell_of(first, second)
    grid = grid_over([first, second], cell, overlap=True)
    surfaces = [raster_surface(uvh, grid) for uvh in (first, second)]
    difference = surfaces[1].heights_m - surfaces[0].heights_m
    pattern = surface_pattern(difference, grid, wanted.alpha)
    units = _units(grid, wanted.unit_cells)
    limit = float(np.nanquantile(np.abs(difference), 0.95)) or cell
    maps: dict[str, tuple[GridValues, Grid, colours.ColourClasses, str, float]] = {
        "difference": (difference, grid, colours.deviation_classes(limit), "mm", 1e3)
    }
    for name, uvh, surface in zip(("reference", "cloud"), (first, second), surfaces, strict=True):
        density, distance = density_map(uvh, units), distance_map(uvh, grid)
        rms = rms_map(uvh, residuals_of(uvh, surface.heights_m, grid), units)
        scale = cell / (2.0 * CLASSES_IN_METRES)  # the source has cells of 1 m
        maps[f"density-{name}"] = (density, units, colours.density_classes(float(density.max())), "/m2", 1.0)
        maps[f"distance-{name}"] = (distance, grid, colours.scaled(colours.DISTANCE_CLASSES, scale), "mm", 1e3)
        maps[f"rms-{name}"] = (rms, units, colours.scaled(colours.RMS_CLASSES, _rms_scale(rms)), "mm", 1e3)
        maps[f"height-std-{name}"] = (
            surface.std_m, grid, colours.scaled(colours.RMS_CLASSES, _rms_scale(surface.std_m)), "mm", 1e3,
        )  # fmt: skip
    files: Files = {}
    is_map = view[2] >= SEEN_FROM_ABOVE * np.linalg.norm(view)
    frame = GridFrame(grid, (float(corner[0]), float(corner[1])), crs_wkt if is_map else None)
    for name, (values, cells, classes, unit, factor) in maps.items():
        files[f"{name}.png"] = ("image/png", grid_png(values, classes, unit, factor))
        files |= grid_files(name, values, replace(frame, grid=cells), "1/m2" if unit == "/m2" else "m")
    figures = PatternFigures(
        cell_m=cell, rows=grid.rows, columns=grid.columns,
        common_cells=int(np.isfinite(difference).sum()), gross_cells=pattern.gross_cells,
        offset_m=pattern.offset_m, tilt_right_mrad=pattern.tilt_u_mrad, tilt_up_mrad=pattern.tilt_v_mrad,
        std_m=pattern.std_m, wavelength_m=pattern.wavelength_m, stripes_azimuth_gon=pattern.stripes_azimuth_gon,
        amplitude_m=pattern.amplitude_m, wave_p_value=pattern.wave_p_value, direction_gon=pattern.direction_gon,
        direction_p_value=pattern.direction_p_value, significant=pattern.significant,
    )  # fmt: skip
    return figures, files


def _cell_of(first: Points, second: Points) -> float:
    """Give cells of which the sparser surface fills each with some points."""
    cells = []
    for uvh in (first, second):
        extent = np.maximum(np.ptp(uvh[:, :2], axis=0), 1e-3)
        cells.append(wished_cell(len(uvh), (float(extent[0]), float(extent[1])), POINTS_PER_CELL))
    return max(cells)


def _units(grid: Grid, cells: int) -> Grid:
    """Give the analysis units: so many cells along an edge, over the same area."""
    rows, columns = -(-grid.rows // cells), -(-grid.columns // cells)
    return replace(grid, cell_m=grid.cell_m * cells, rows=rows, columns=columns)


def _rms_scale(values: GridValues) -> float:
    """Scale the source's classes, which end at 0.5 m, to what a terrestrial scan has: the largest tenth is dark red."""
    known = values[np.isfinite(values)]
    return 1.0 if len(known) == 0 else min(1.0, max(float(np.quantile(known, 0.9)), 1e-6) / 0.5)
