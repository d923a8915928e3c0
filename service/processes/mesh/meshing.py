"""Lay the mesh of a job, and write the result of `mesh`."""

from collections.abc import Sequence

import numpy as np
from pydantic import TypeAdapter
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Colors, Points, Vector3
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.meshing.body import ModelledBody, modelled_body
from algorithms.meshing.constraint_lines import ConstraintLine
from algorithms.meshing.options import MeshOptions
from algorithms.meshing.plinth import Plinth
from algorithms.meshing.texture import Texture
from algorithms.progress import ProgressSection
from schemas.results.mesh_result import MeshFaults, MeshingDocument, MeshStepFigures
from schemas.results.registration_result import Artifact
from service.formats.mesh_writers import MESH_WRITERS, TEXTURED_WRITERS
from service.ports import Json, StepContext
from service.processes.mesh.contouring import contours_on
from service.processes.mesh.patching import fitted_patches, patch_figures, write_patches
from service.processes.mesh.texturing import texture_figures, texture_of, write_textured
from service.use_cases.documents.deviation_documents import deviation_figures
from service.use_cases.steps.cleaned_clouds import CLEANED, CleanedFrame, cleaned_frame
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_photos import placed_photos

MESHED, WRITING = 0.9, 0.97
COLOUR_POINTS = 3
"""A vertex has the mean colour of so many points next to it."""


def mesh(context: StepContext, arguments: Json) -> Json:
    """Clean, lay the mesh, and store document and file.

    Raises
    ------
    InvalidInputError
        A step left nothing, or the resolution is too fine for the extent.
    """
    job_id = arguments["job_id"]
    cleaned = cleaned_frame(context, arguments["stations"], arguments["cleaning"])
    origin = cleaned.frame.origin_m
    points = np.concatenate([left.points for _, left in cleaned.stations()])
    options = TypeAdapter(MeshOptions).validate_python(arguments["surface"])
    cuts = [(np.array(cut["point_m"]) - origin, np.array(cut["normal"], dtype=float)) for cut in arguments["cuts"]]
    lines = [
        ConstraintLine(np.array(line["start_m"]) - origin, np.array(line["end_m"]) - origin)
        for line in arguments["lines"]
    ]
    progress = ProgressSection(context.progress, CLEANED, MESHED)
    body = modelled_body(
        points, _sensors(cleaned), options, cuts, progress, lines, _plinth(arguments["plinth"], origin)
    )
    patches = fitted_patches(points, arguments["patches"], origin)
    photos = _photos(context, arguments, cleaned)
    texture: Texture | None = None
    if arguments["texture"] is not None:
        progress = ProgressSection(context.progress, MESHED, WRITING)
        texture = texture_of(body.mesh, photos, arguments["texture"], progress)
    files: dict[str, list[Artifact] | None] = dict.fromkeys(("mesh", "patch_file"))
    context.progress.report(WRITING, "writing")
    if arguments["wanted_mesh"] is not None:
        name = arguments["wanted_mesh"]["format"]
        if texture is not None and name in TEXTURED_WRITERS:
            files["mesh"] = write_textured(context, job_id, name, body.mesh, origin, texture)
        else:
            files["mesh"] = [_write(context, job_id, name, body, cleaned, points)]
    if arguments["wanted_patch_file"] is not None and patches:
        name = arguments["wanted_patch_file"]["format"]
        files["patch_file"] = [write_patches(context, job_id, name, arguments["patches"], patches, origin)]
    document = MeshingDocument(
        points=len(points),
        vertices=len(body.mesh.vertices),
        triangles=len(body.mesh.triangles),
        resolution_m=body.resolution_m,
        normal_radius_m=body.normal_radius_m,
        watertight=body.watertight,
        area_m2=body.area_m2,
        volume_m3=body.volume_m3,
        cleaning=cleaned.steps(),
        steps=[
            MeshStepFigures(step=each.step, triangles=each.triangles, holes_closed=each.holes_closed)
            for each in body.steps
        ],
        faults=[
            MeshFaults(kind=fault.kind, count=fault.count, places_m=_places(fault.places_m + origin))
            for fault in body.faults
        ],
        deviations=deviation_figures(body.deviations_m, points + origin, arguments["tolerance_m"]),
        patches=patch_figures(arguments["patches"], patches) if patches else None,
        texture=None if texture is None else texture_figures(body.mesh, photos, texture),
        contours=contours_on(body.mesh, photos, arguments["contours"], origin),
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=[*cleaned.frame.notes(), *cleaned.cleaned.remarks, *_remarks(cleaned), *_untextured(arguments)],
        **files,
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"triangles": document.triangles}


def _photos(context: StepContext, arguments: Json, cleaned: CleanedFrame) -> Sequence[PlacedPhoto]:
    """Give the photos of all stations, where something is wanted of them."""
    if arguments["texture"] is None and not arguments["contours"]:
        return []
    return [photo for station in arguments["stations"] for photo in placed_photos(context, station, cleaned.frame)]


def _plinth(wanted: Json | None, origin_m: Vector3) -> tuple[Plinth, float | None] | None:
    """Give the body that the surface stands on, and where the surface is cut above it."""
    if wanted is None:
        return None
    points = np.array([plane["point_m"] for plane in wanted["planes"]]) - origin_m
    normals = np.array([plane["normal"] for plane in wanted["planes"]], dtype=np.float64)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return Plinth(points, normals, wanted["top"]), wanted["above_m"]


def _sensors(cleaned: CleanedFrame) -> Points:
    """Give where the instrument of each point stood, (n, 3) in the common frame; NaN where nobody knows."""
    places: list[Array] = []
    for station, left in cleaned.stations():
        sensor = station.scan.sensor_m
        place = np.full(3, np.nan) if sensor is None else station.common_from_scan.apply(sensor)
        places.append(np.tile(place, (len(left.numbers), 1)))
    return np.concatenate(places)


def _remarks(cleaned: CleanedFrame) -> Sequence[str]:
    return [
        f"where the instrument of '{station.scan.name}' stood is not known: normals are turned like their neighbours'"
        for station, _ in cleaned.stations()
        if station.scan.sensor_m is None
    ]


def _untextured(arguments: Json) -> Sequence[str]:
    wanted = arguments["wanted_mesh"]
    if arguments["texture"] is None or wanted is None or wanted["format"] in TEXTURED_WRITERS:
        return []
    return [f"'{wanted['format']}' is written without the texture: ask for 'obj' or 'glb'"]


def _places(points: Points) -> list[tuple[float, float, float]]:
    return [(x, y, z) for x, y, z in points.tolist()]


def _write(
    context: StepContext, job_id: str, name: str, body: ModelledBody, cleaned: CleanedFrame, points: Points
) -> Artifact:
    writer = MESH_WRITERS[name]
    filename = f"mesh{writer.ending}"
    with output_file(context, job_id, filename) as path:
        writer.write(path, body.mesh, cleaned.frame.origin_m, _colors(cleaned, points, body.mesh.vertices))
    return artifact(context, job_id, filename, writer.media_type)


def _colors(cleaned: CleanedFrame, points: Points, vertices: Points) -> Colors | None:
    """Give each vertex the mean colour of the points next to it; None where a station has none."""
    stations = cleaned.stations()
    colors = [station.scan.color[left.numbers] for station, left in stations if station.scan.color is not None]
    if len(colors) < len(stations):
        return None
    _, nearest = cKDTree(points).query(vertices, k=min(COLOUR_POINTS, len(points)))
    chosen = np.concatenate(colors)[np.asarray(nearest).reshape(len(vertices), -1)]
    return np.asarray(np.rint(chosen.mean(axis=1)).astype(np.uint8))
