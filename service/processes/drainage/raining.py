"""The step of `drainage`: read, model the terrain, let it rain, describe, store."""

import json
from collections.abc import Sequence

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array, Points, Vector3
from algorithms.deviations import colour_classes as colours
from algorithms.deviations.rasters import Grid
from algorithms.errors import InvalidInputError
from algorithms.progress import NoProgress, ProgressSection
from algorithms.terrain.drainage.derivatives import Derivatives, derivatives
from algorithms.terrain.drainage.hollows import Hollow, hollow_paths, hollows_of
from algorithms.terrain.drainage.rain import Rain, rain_on
from algorithms.terrain.drainage.structure_lines import ridges, valleys
from algorithms.terrain.ground import Ground, ground_of
from algorithms.terrain.low_points import low_points
from algorithms.terrain.models import BridgedGaps, TerrainModels, gaps_in_words, terrain_models
from algorithms.terrain.options import EVERY_FILTER
from schemas.results.drainage_result import DrainageDocument, HollowFigures, TerrainLine
from schemas.results.registration_result import Artifact
from service.formats.dxf_lines_writer import LineLayer, dxf_lines
from service.formats.writers.grid_files import Files, GridFrame, grid_files
from service.ports import Json, StepContext
from service.use_cases.reports.grid_pictures import grid_png
from service.use_cases.steps.placed_stations import read_stations

VALLEY, RIDGE, PATH = "valley", "ridge", "hollow-path"
COLOURS = {VALLEY: (20, 80, 200), RIDGE: (160, 80, 20), PATH: (200, 30, 160)}
MOST_HOLLOWS = 1000
READ, FILTERED, RAINED = 0.2, 0.6, 0.8

Line = tuple[TerrainLine, Points]


def let_it_rain(context: StepContext, arguments: Json) -> Json:
    """Model a terrain and let it rain on it; store document and downloads.

    Raises
    ------
    InvalidInputError
        Too few points, too many cells, or no ground was found.
    """
    job_id, inputs = arguments["job_id"], arguments["inputs"]
    frame = read_stations(context, arguments["stations"])
    frame.require_heights()
    points = np.concatenate([station.points() for station in frame.stations])
    ground = _ground(points, inputs, ProgressSection(context.progress, READ, FILTERED))
    gaps = BridgedGaps(inputs["gap_m"], inputs["covered_m"])
    models = terrain_models(points[~ground.low], ground.ground[~ground.low], inputs["cell_m"], None, NoProgress(), gaps)
    grid, heights = models.grid, models.dtm_m
    context.progress.report(FILTERED, "raining")
    rain, shape = rain_on(heights), derivatives(heights, grid.cell_m)
    hollows, labels = hollows_of(heights, rain, grid.cell_m)
    context.progress.report(RAINED, "lines")
    paths = hollow_paths(hollows, labels, rain, grid) if inputs["hollow_paths"] else []
    lines = _lines(heights, rain, grid, paths, frame.origin_m, inputs)
    files = frame.renamed(_files(rain, shape, models, lines, frame.origin_m, frame.crs_wkt))
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    bridged = float((~np.isfinite(models.dtm_std_m) & ~models.no_terrain).mean())
    document = DrainageDocument(
        points=len(points),
        ground=int(ground.ground.sum()),
        cell_m=grid.cell_m,
        rows=grid.rows,
        columns=grid.columns,
        mean_slope_deg=_mean_slope_deg(shape, models),
        largest_catchment_m2=float((rain.runoff.max() + 1.0) * grid.cell_m**2),
        lines=[line for line, _ in lines],
        hollow_count=len(hollows),
        hollows=_largest(hollows, grid, frame.origin_m),
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=[
            *frame.notes(),
            *([f"in {bridged:.1%} of the cells the terrain is bridged: too few points are near"] if bridged else []),
            *(f"{said}; lines run on through them" for said in gaps_in_words(models)),
        ],
        artifacts=[
            Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
            for name, (media, data) in files.items()
        ],
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"lines": len(lines)}


def _ground(points: Points, inputs: Json, progress: ProgressSection) -> Ground:
    if inputs.get("filter") is None:
        if len(points) == 0:
            raise InvalidInputError("stations", "the scans have no points", "give others")
        low = low_points(points)
        return Ground(~low, low)
    chosen = TypeAdapter(EVERY_FILTER[inputs["filter"]["name"]]).validate_python(inputs["filter"])
    return ground_of(points, chosen, inputs["cell_m"], progress)


def _mean_slope_deg(shape: Derivatives, models: TerrainModels) -> float:
    slopes = shape.slope_rad[~models.no_terrain]
    return float(np.degrees(np.nanmean(slopes))) if np.isfinite(slopes).any() else 0.0


def _lines(
    heights: Array, rain: Rain, grid: Grid, paths: Sequence[Points], origin_m: Vector3, inputs: Json
) -> list[Line]:
    limits = inputs["least_catchment_m2"], inputs["least_length_m"]
    found = [(VALLEY, each.points, each.catchment_m2) for each in valleys(heights, rain, grid, *limits)]
    if inputs["ridges"]:
        found += [(RIDGE, each.points, each.catchment_m2) for each in ridges(heights, grid, *limits)]
    lines = [_described(kind, points + origin_m, catchment) for kind, points, catchment in found]
    return lines + [_described(PATH, path + origin_m, None) for path in paths]


def _described(kind: str, points: Points, catchment_m2: float | None) -> Line:
    length = float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum())
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    return TerrainLine(kind=kind, length_m=length, catchment_m2=catchment_m2, lowest_m=low, highest_m=high), points


def _files(
    rain: Rain, shape: Derivatives, models: TerrainModels, lines: Sequence[Line], origin_m: Vector3, crs_wkt: str | None
) -> Files:
    grid = models.grid
    frame, base = GridFrame(grid, (float(origin_m[0]), float(origin_m[1])), crs_wkt), float(origin_m[2])
    catchment = (rain.runoff + 1.0) * grid.cell_m**2
    grids = {
        "slope": (np.degrees(shape.slope_rad), "deg"), "aspect": (np.degrees(shape.aspect_rad), "deg"),
        "profile-curvature": (shape.profile_curvature, "1/m"), "plan-curvature": (shape.plan_curvature, "1/m"),
        "mean-curvature": (shape.mean_curvature, "1/m"), "catchment": (catchment, "m2"),
        "filled": (rain.filled_m + base, "m"),
    }  # fmt: skip
    files: Files = {}
    for name, (values, unit) in grids.items():
        files |= grid_files(name, np.where(models.no_terrain, np.nan, values), frame, unit)
    steps = np.log10(catchment)
    files["catchment.png"] = ("image/png", grid_png(steps, colours.density_classes(float(steps.max())), "log m2"))
    files["lines.dxf"] = ("image/vnd.dxf", _drawing(lines))
    files["lines.geojson"] = ("application/geo+json", _geojson(lines))
    return files


def _drawing(lines: Sequence[Line]) -> bytes:
    layers = []
    for kind, colour in COLOURS.items():
        own = [points for line, points in lines if line.kind == kind]
        if own:
            starts, ends = (np.concatenate([points[part] for points in own]) for part in (np.s_[:-1], np.s_[1:]))
            layers.append(LineLayer(kind, colour, starts, ends))
    return dxf_lines(layers)


def _geojson(lines: Sequence[Line]) -> bytes:
    """Write lines in the coordinates of the project, which the format would have as longitude and latitude."""
    features = [
        {
            "type": "Feature",
            "properties": line.model_dump(),
            "geometry": {"type": "LineString", "coordinates": points.round(4).tolist()},
        }
        for line, points in lines
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def _largest(hollows: Sequence[Hollow], grid: Grid, origin_m: Vector3) -> list[HollowFigures]:
    centres = grid.centres() + origin_m[:2]
    return [
        HollowFigures(
            x_m=float(centres[each.bottom, 0]),
            y_m=float(centres[each.bottom, 1]),
            bottom_m=each.bottom_m + float(origin_m[2]),
            rim_m=each.rim_m + float(origin_m[2]),
            area_m2=each.cells * grid.cell_m**2,
            volume_m3=each.volume_m3,
        )
        for each in sorted(hollows, key=lambda each: -each.volume_m3)[:MOST_HOLLOWS]
    ]
