"""What `terrain` writes of its models: grids, pictures, contour lines, a mesh."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from algorithms.arrays import Array, Flags, Points, Vector3
from algorithms.deviations import colour_classes as colours
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.deviations.surface_maps import density_map, distance_map, rms_map
from algorithms.terrain.contours import contours
from algorithms.terrain.hillshade import hillshade
from algorithms.terrain.models import Canopy, TerrainModels, residuals_above
from service.formats.dxf_lines_writer import LineLayer, dxf_lines
from service.formats.writers.grid_files import Files, GridFrame, grid_files
from service.ports import Json
from service.use_cases.reports.grid_pictures import grid_png, png

UNIT_CELLS = 5
"""Cells along an analysis unit: the source takes 25 m² over a model of 1 m."""
CONTOURS, STANDS = (150, 90, 40), (30, 120, 60)
"""Colours of contour lines and of the lines of objects' heights."""


def drawn(
    points: Points,
    ground: Flags,
    models: TerrainModels,
    canopy: Canopy | None,
    origin_m: Vector3,
    inputs: Json,
    crs_wkt: str | None = None,
) -> Files:
    """Give all files of the models.

    Parameters
    ----------
    points, ground
        (n, 3) in the reduced common frame [m], and (n,) which lie on the ground.
    models, canopy
        Of heights.
    origin_m
        Of the common frame [m].
    inputs
        Of the process.
    crs_wkt
        Coordinate reference system of the world; None: not known.
    """
    grid, base = models.grid, float(origin_m[2])
    frame = GridFrame(grid, (float(origin_m[0]), float(origin_m[1])), crs_wkt, inputs["grid_format"])
    shade = hillshade(models.dtm_m, grid, inputs["light_azimuth_deg"], inputs["light_altitude_deg"])
    shade[models.no_terrain] = 255
    grids = {"dtm": models.known_dtm_m + base, "dsm": models.known_dsm_m + base, "ndsm": models.known_ndsm_m}
    if canopy is not None:
        grids["canopy"] = np.where(models.no_surface, np.nan, canopy.heights_m + base)
        grids["stand-height"] = np.where(models.no_terrain, np.nan, canopy.stand_m)
    files: Files = {"hillshade.png": ("image/png", png(np.repeat(shade[::-1, :, None], 3, axis=2)))}
    for name, values in grids.items():
        files |= grid_files(name, values, frame, "m")
    if inputs["maps"]:
        files |= _maps(points[ground], models, frame)
    if inputs.get("contour_interval_m") is not None:
        files["contours.dxf"] = ("image/vnd.dxf", _contours(models, origin_m, inputs["contour_interval_m"]))
    if inputs["mesh"]:
        files["terrain.ply"] = ("application/octet-stream", _mesh(models.known_dtm_m, grid, origin_m))
    return files


def _maps(on_ground: Points, models: TerrainModels, frame: GridFrame) -> Files:
    """Map what the terrain is worth: density, distance, residuals and expected height accuracy."""
    grid = models.grid
    units = replace(
        grid, cell_m=grid.cell_m * UNIT_CELLS, rows=-(-grid.rows // UNIT_CELLS), columns=-(-grid.columns // UNIT_CELLS)
    )
    density = density_map(on_ground, units)
    maps: dict[str, tuple[GridValues, Grid, colours.ColourClasses, str]] = {
        "density": (density, units, colours.density_classes(float(density.max())), "/m2"),
        "distance": (distance_map(on_ground, grid), grid, colours.DISTANCE_CLASSES, "m"),
        "rms": (rms_map(on_ground, residuals_above(on_ground, models), units), units, colours.RMS_CLASSES, "m"),
        "height-std": (models.dtm_std_m, grid, colours.RMS_CLASSES, "m"),
    }
    files: Files = {}
    for name, (values, cells, classes, unit) in maps.items():
        files[f"{name}.png"] = ("image/png", grid_png(values, classes, unit))
        files |= grid_files(name, values, replace(frame, grid=cells), "1/m2" if unit == "/m2" else unit)
    return files


def _contours(models: TerrainModels, origin_m: Vector3, interval_m: float) -> bytes:
    """Draw the contour lines of the terrain and of the heights of objects, the latter at the height of the terrain."""
    base = float(origin_m[2])
    layers = [
        _layer(f"contour {each.height_m:g}", CONTOURS, each.lines, origin_m)
        for each in contours(models.known_dtm_m, models.grid, interval_m, base)
    ]
    plan = np.array([origin_m[0], origin_m[1], 0.0])
    layers += [
        _layer(f"above ground {each.height_m:g}", STANDS, each.lines, plan)
        for each in contours(models.known_ndsm_m, models.grid, interval_m)
        if each.height_m > 0.0
    ]
    return dxf_lines(layers)


def _layer(name: str, colour: tuple[int, int, int], lines: Sequence[Array], origin_m: Vector3) -> LineLayer:
    starts = np.concatenate([line[:-1] for line in lines])
    ends = np.concatenate([line[1:] for line in lines])
    return LineLayer(name, colour, starts + origin_m, ends + origin_m)


def _mesh(heights_m: GridValues, grid: Grid, origin_m: Vector3) -> bytes:
    """Write two triangles for each four middles of cells with heights, in full coordinates."""
    known = np.isfinite(heights_m.ravel())
    vertices = (np.column_stack([grid.centres(), heights_m.ravel()]) + origin_m)[known]
    numbers = np.where(known, np.cumsum(known) - 1, -1).reshape(grid.shape)
    a, b, c, d = (part.ravel() for part in (numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    faces = faces[(faces >= 0).all(axis=1)]
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    records = np.zeros(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    records["count"], records["corners"] = 3, faces
    return b"".join([header.encode(), vertices.astype("<f8").tobytes(), records.tobytes()])
