"""The step of `terrain`: read, classify, model, describe, store."""

import time
from dataclasses import asdict

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array, Points
from algorithms.errors import AlgorithmError, CancelledError
from algorithms.progress import NoProgress, ProgressSection
from algorithms.terrain.ground import Ground, ground_of, row_beside
from algorithms.terrain.learned_slope import LabelledTerrain, learned_slope
from algorithms.terrain.linear_prediction import Covariance
from algorithms.terrain.models import (
    BridgedGaps,
    Canopy,
    TerrainModels,
    canopy_over,
    gaps_in_words,
    residuals_above,
    terrain_models,
)
from algorithms.terrain.options import EVERY_FILTER, SlopeFilter, TerrainFilter
from schemas.results.registration_result import Artifact
from schemas.results.terrain_result import ComparedFilter, GroundResiduals, HeightFigures, TerrainDocument
from service.formats.las_attributes import CLASSIFICATION
from service.formats.writers import ScalarField, writer_of
from service.formats.writers.grid_files import Files
from service.ports import Json, StepContext
from service.processes.terrain.pictures import drawn
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_stations import CommonFrame, cloud_in_world, read_stations
from service.use_cases.steps.run_features import read_stored_scan

OBJECT, GROUND, LOW = 1, 2, 7
"""Classes of LAS: unclassified, ground, low point."""
CLASSES = ScalarField("classification", "class: 2 ground, 7 low", "u1")
CLASSES_BEFORE = ScalarField("class_before", "class in the uploaded file", "u1")
HEIGHTS = ScalarField("above_ground_m", "height above the terrain [m]", "f4")
READ, LEARNED, FILTERED, COMPARED, MODELLED, DRAWING = 0.2, 0.3, 0.55, 0.7, 0.8, 0.9
WITHIN_M = 0.1
"""Of the share of ground points near the terrain, as the source has it."""


def model_terrain(context: StepContext, arguments: Json) -> Json:
    """Find the ground and model heights; store document and downloads.

    Raises
    ------
    InvalidInputError
        Too few points, too many cells, or no ground was found.
    """
    job_id, inputs = arguments["job_id"], arguments["inputs"]
    frame = read_stations(context, arguments["stations"], attributes=arguments["wanted"] is not None)
    frame.require_heights()
    points = np.concatenate([station.points() for station in frame.stations])
    chosen = _chosen(context, arguments)
    ground = ground_of(points, chosen, inputs["cell_m"], ProgressSection(context.progress, LEARNED, FILTERED))
    compared = _compared(context, points, ground, inputs)
    models = terrain_models(
        points,
        ground.ground,
        inputs["cell_m"],
        _covariance(inputs),
        ProgressSection(context.progress, COMPARED, MODELLED),
        BridgedGaps(inputs["gap_m"], inputs["covered_m"]),
    )
    canopy = None
    if inputs["canopy"]:
        part = ProgressSection(context.progress, MODELLED, DRAWING)
        canopy = canopy_over(points, models, chosen, inputs["cell_m"], part)
    context.progress.report(DRAWING, "maps and drawings")
    files = frame.renamed(drawn(points, ground.ground, models, canopy, frame.origin_m, inputs, frame.crs_wkt))
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    document = TerrainDocument(
        points=len(points),
        ground=int(ground.ground.sum()),
        objects=int((~ground.ground & ~ground.low).sum()),
        low=int(ground.low.sum()),
        filter=asdict(chosen),
        cell_m=inputs["cell_m"],
        rows=models.grid.rows,
        columns=models.grid.columns,
        no_data_share=float(models.no_terrain.mean()),
        models=_figures(models, canopy, float(frame.origin_m[2])),
        residuals=_residuals(points, ground, models),
        compared=compared,
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=[*frame.notes(), *_remarks(ground, models)],
        artifacts=_artifacts(job_id, files),
        classified=_classified(context, arguments, frame, points, ground, models),
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"ground": document.ground}


def _chosen(context: StepContext, arguments: Json) -> TerrainFilter:
    """Give the filter, with what it learns from labelled terrain."""
    inputs, training = arguments["inputs"], arguments["training"]
    chosen: TerrainFilter = TypeAdapter(EVERY_FILTER[inputs["filter"]["name"]]).validate_python(inputs["filter"])
    if not training or not isinstance(chosen, SlopeFilter):
        return chosen
    scans = [read_stored_scan(context, training[name]) for name in ("ground", "objects")]
    origin = scans[0].origin_m
    ground, objects = (scan.points + (scan.origin_m - origin) for scan in scans)
    labels = np.arange(len(ground) + len(objects)) < len(ground)
    known = LabelledTerrain(np.concatenate([ground, objects]), labels)
    return learned_slope([known], chosen, inputs["cell_m"], ProgressSection(context.progress, READ, LEARNED))


def _compared(context: StepContext, points: Points, ground: Ground, inputs: Json) -> list[ComparedFilter]:
    rows = []
    names = inputs["compare_filters"]
    part = ProgressSection(context.progress, FILTERED, COMPARED)
    for k, name in enumerate(names):
        section = ProgressSection(part, k / len(names), (k + 1) / len(names))
        started = time.perf_counter()
        try:
            found = ground_of(points, EVERY_FILTER[name](), inputs["cell_m"], section)
        except CancelledError:
            raise
        except AlgorithmError as error:
            rows.append(
                ComparedFilter(
                    name=name, ground=None, kappa=None, only_here=None, only_chosen=None,
                    seconds=time.perf_counter() - started, reason=str(error),
                )
            )  # fmt: skip
            continue
        rows.append(ComparedFilter(**asdict(row_beside(name, found, ground)), seconds=time.perf_counter() - started))
    return rows


def _covariance(inputs: Json) -> Covariance | None:
    return None if inputs.get("prediction") is None else Covariance(**inputs["prediction"])


def _figures(models: TerrainModels, canopy: Canopy | None, base_m: float) -> list[HeightFigures]:
    heights: dict[str, tuple[Array, float]] = {
        "dtm": (models.known_dtm_m, base_m), "dsm": (models.known_dsm_m, base_m), "ndsm": (models.known_ndsm_m, 0.0),
    }  # fmt: skip
    if canopy is not None:
        heights |= {"canopy": (np.where(models.no_surface, np.nan, canopy.heights_m), base_m)}
        heights |= {"stand-height": (np.where(models.no_terrain, np.nan, canopy.stand_m), 0.0)}
    return [
        HeightFigures(
            name=name,
            lowest_m=float(np.nanmin(values)) + base,
            mean_m=float(np.nanmean(values)) + base,
            highest_m=float(np.nanmax(values)) + base,
        )
        for name, (values, base) in heights.items()
    ]


def _residuals(points: Points, ground: Ground, models: TerrainModels) -> GroundResiduals:
    residuals = residuals_above(points[ground.ground], models)
    known = np.isfinite(models.dtm_std_m)
    return GroundResiduals(
        rms_m=float(np.sqrt((residuals**2).mean())),
        share_within_10_cm=float((np.abs(residuals) <= WITHIN_M).mean()),
        expected_std_m=float(np.median(models.dtm_std_m[known])) if known.any() else None,
        unknown_share=float(1.0 - known.mean()),
    )


def _remarks(ground: Ground, models: TerrainModels) -> list[str]:
    remarks = []
    if ground.low.any():
        remarks.append(f"{int(ground.low.sum())} points lie alone below the ground and take no part (class {LOW})")
    unknown = float((~np.isfinite(models.dtm_std_m) & ~models.no_terrain).mean())
    if unknown > 0.0:
        remarks.append(f"in {unknown:.1%} of the cells the terrain is bridged: too few ground points are near")
    return [*remarks, *gaps_in_words(models)]


def _artifacts(job_id: str, files: Files) -> list[Artifact]:
    return [
        Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
        for name, (media, data) in files.items()
    ]


def _classified(
    context: StepContext, arguments: Json, frame: CommonFrame, points: Points, ground: Ground, models: TerrainModels
) -> list[Artifact] | None:
    """Write the points of all stations with their classes and heights above the terrain, where that is wanted."""
    if arguments["wanted"] is None:
        return None
    writer = writer_of(arguments["wanted"]["format"])
    classes = np.where(ground.low, LOW, np.where(ground.ground, GROUND, OBJECT)).astype(np.uint8)
    above = residuals_above(points, models).astype(np.float32)
    above[models.no_terrain.ravel()[models.grid.cells_of(points)]] = np.nan
    clouds, start = [], 0
    for station in frame.stations:
        part = slice(start, start + len(station.scan))
        start = part.stop
        if len(station.scan) == 0:
            continue
        scalars: dict[str, Array] = {CLASSES.name: classes[part], HEIGHTS.name: above[part]}
        fields: tuple[ScalarField, ...] = (CLASSES, HEIGHTS)
        before = station.scan.attributes.get(CLASSIFICATION)
        if before is not None:
            scalars[CLASSES_BEFORE.name], fields = before, (*fields, CLASSES_BEFORE)
        numbers = np.arange(len(station.scan))
        clouds.append(cloud_in_world(station, frame.origin_m, numbers, points[part], scalars=scalars, fields=fields))
    filename = f"{frame.file_stem('classified')}{writer.ending}"
    with output_file(context, arguments["job_id"], filename) as path:
        writer.write(path, clouds, NoProgress())
    return [artifact(context, arguments["job_id"], filename, writer.media_type)]
