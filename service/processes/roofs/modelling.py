"""Model the roofs of a job, and write the result of `roofs`."""

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array, Points, Vector3
from algorithms.errors import InvalidInputError
from algorithms.roofs.building import ROOF, BuildingModel, ground_height_m, modelled_building
from algorithms.roofs.judgement import BuildingFigures, figures_of
from algorithms.roofs.options import RoofOptions
from algorithms.roofs.outlines import found_outlines
from algorithms.roofs.partition import area_of
from schemas.results.registration_result import Artifact
from schemas.results.roofs_result import ModelledBuilding, RoofFace, RoofsDocument
from service.formats.city_writers import CITY_WRITERS, NamedBuilding
from service.ports import Json, StepContext
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_stations import read_stations

READ, MODELLED = 0.2, 0.95
AROUND_PLAN_M = 5.0
LEVEL_DEG = 0.1
"""Flatter faces have no direction in which water runs off."""


def model_roofs(context: StepContext, arguments: Json) -> Json:
    """Model every building, and store document and file.

    Raises
    ------
    InvalidInputError
        None of the plans could be modelled, or without plans no building found.
    """
    job_id = arguments["job_id"]
    options = TypeAdapter(RoofOptions).validate_python(arguments["roof"])
    frame = read_stations(context, arguments["stations"])
    frame.require_heights()
    points = np.concatenate([station.points() for station in frame.stations])
    plans = arguments["plans"] or _found_plans(points, options, arguments["least_plan_m2"], frame.origin_m)
    documents: list[ModelledBuilding] = []
    buildings: list[NamedBuilding] = []
    for number, plan in enumerate(plans):
        context.progress.report(READ + (MODELLED - READ) * number / len(plans), plan["name"])
        outline = np.array(plan["corners_m"], dtype=np.float64) - frame.origin_m[:2]
        ground = None if plan["ground_m"] is None else plan["ground_m"] - frame.origin_m[2]
        try:
            near = _near(points, outline)
            ground, ground_std = ground_height_m(near, outline) if ground is None else (float(ground), 0.0)
            model = modelled_building(near, outline, ground, options)
        except InvalidInputError as fault:
            documents.append(_not_modelled(plan, str(fault)))
            continue
        found = arguments["plans"] is None
        figures = figures_of(model, near, outline, options, found_plan=found, ground_std_m=ground_std)
        documents.append(_document(plan, model, figures, float(frame.origin_m[2]), found_plan=found))
        attributes = {"measuredHeight": round(_height(model), 3), "status": documents[-1].status}
        buildings.append(NamedBuilding(plan["name"], model, attributes))
    if not buildings:
        raise InvalidInputError("plans", f"none could be modelled; of the first: {documents[0].reason}")
    files: list[Artifact] | None = None
    if arguments["wanted"] is not None:
        writer = CITY_WRITERS[arguments["wanted"]["format"]]
        filename = f"{frame.file_stem('buildings')}{writer.ending}"
        with output_file(context, job_id, filename) as path:
            writer.write(path, buildings, frame.origin_m, frame.crs_wkt)
        files = [artifact(context, job_id, filename, writer.media_type)]
    document = RoofsDocument(
        buildings=documents,
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=frame.notes(),
        building_models=files,
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"buildings": len(buildings)}


def _found_plans(points: Points, options: RoofOptions, least_m2: float, origin_m: Vector3) -> list[Json]:
    """Find plans, and give them as a request would."""
    outlines, grounds = found_outlines(points, options, least_m2)
    return [
        {
            "name": f"building-{number}",
            "corners_m": [(x, y) for x, y in (outline + origin_m[:2]).tolist()],
            "ground_m": ground + float(origin_m[2]),
        }
        for number, (outline, ground) in enumerate(zip(outlines, grounds, strict=True), start=1)
    ]


def _near(points: Points, outline: Array) -> Points:
    """Keep what lies over a plan or near it: all that modelling one building looks at."""
    low, high = outline.min(axis=0) - AROUND_PLAN_M, outline.max(axis=0) + AROUND_PLAN_M
    return np.asarray(points[((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1)])


def _height(model: BuildingModel) -> float:
    return float(model.vertices[:, 2].max()) - model.ground_m


def _not_modelled(plan: Json, reason: str) -> ModelledBuilding:
    return ModelledBuilding(
        name=plan["name"],
        corners_m=plan["corners_m"],
        points=0,
        ground_m=None,
        faces=[],
        share_without_face=0.0,
        status="not-modelled",
        watertight=False,
        volume_m3=None,
        reason=reason,
    )


def _document(
    plan: Json, model: BuildingModel, figures: BuildingFigures, origin_height_m: float, *, found_plan: bool
) -> ModelledBuilding:
    areas = np.zeros(len(model.planes))
    for surface in model.surfaces:
        if surface.kind == ROOF and surface.plane is not None:
            areas[surface.plane] += sum(area_of(model.vertices[ring, :2]) for ring in surface.rings)
    faces = []
    for plane, area in zip(model.planes, areas.tolist(), strict=True):
        a, b, _ = plane.parameters.tolist()
        slope = float(np.hypot(a, b))
        degrees = float(np.degrees(np.arctan(slope)))
        azimuth = float(np.degrees(np.arctan2(-a, -b)) / 0.9) % 400.0
        faces.append(
            RoofFace(
                slope_deg=degrees,
                azimuth_gon=azimuth if degrees > LEVEL_DEG else None,
                area_m2=area * float(np.sqrt(1.0 + slope**2)),
                points_before=plane.before,
                points_after=plane.after,
                rms_m=plane.rms_m,
            )
        )
    reason = figures.reason(model.volume_m3, found_plan=found_plan)
    if not model.watertight:
        reason = "incomplete: its polygons bound no body" + (f"; {reason}" if reason else "")
    return ModelledBuilding(
        name=plan["name"],
        corners_m=plan["corners_m"],
        points=model.points,
        ground_m=model.ground_m + origin_height_m,
        faces=faces,
        share_without_face=figures.share_without_face,
        status="incomplete" if reason else "modelled",
        rms_m=figures.rms_m,
        largest_gap_m=figures.largest_gap_m,
        unseen_share=figures.unseen_share,
        misfit_m3=figures.misfit_m3,
        misfit_std_m3=figures.misfit_std_m3,
        watertight=model.watertight,
        volume_m3=model.volume_m3 if model.watertight else None,
        reason=reason,
    )
