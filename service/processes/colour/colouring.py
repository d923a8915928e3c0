"""Colour the stations of a job, and write the result of `colour`."""

from collections.abc import Sequence

import numpy as np
from pydantic import TypeAdapter

from algorithms.arrays import Array
from algorithms.cleaning.best_view import point_normals
from algorithms.cleaning.cleaned_stations import PlacedScan
from algorithms.colouring.coloured_cloud import ColouredCloud, coloured_cloud
from algorithms.colouring.options import ColouringOptions
from algorithms.colouring.photo_views import PlacedPhoto
from algorithms.errors import InvalidInputError
from algorithms.progress import ProgressSection
from schemas.results.colouring_result import ColouringDocument, PhotoFigures, PhotoTurnFigures
from schemas.results.registration_result import Artifact
from service.formats.writers import writer_of
from service.ports import Json, StepContext
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_photos import placed_photos
from service.use_cases.steps.placed_stations import CommonFrame, cloud_in_world, read_stations


def colour(context: StepContext, arguments: Json) -> Json:
    """Colour, and store document and file.

    Raises
    ------
    InvalidInputError
        No station has a photo with camera and pose, or none shows a point.
    """
    job_id, stations = arguments["job_id"], arguments["stations"]
    options = TypeAdapter(ColouringOptions).validate_python(arguments["options"])
    frame = read_stations(context, stations, attributes=arguments["wanted"] is not None)
    photos = [photo for station in stations for photo in placed_photos(context, station, frame)]
    if not photos:
        raise InvalidInputError("photos", "no station has a photo with camera and pose")
    points = np.concatenate([station.points() for station in frame.stations])
    normals = np.concatenate([_normals(station) for station in frame.stations])
    result = coloured_cloud(points, normals, photos, options, ProgressSection(context.progress, 0.2, 0.85))
    if not result.coloured.any():
        raise InvalidInputError("photos", "none of them shows a point", "check cameras, mounts and poses")
    files: list[Artifact] | None = None
    notes: tuple[str, ...] = ()
    if arguments["wanted"] is not None:
        files, notes = _write(context, job_id, arguments["wanted"]["format"], frame, result)
    document = ColouringDocument(
        points=len(points),
        coloured=int(result.coloured.sum()),
        photos=_figures(photos, result),
        fall_off=_three(np.exp(result.balance.log_fall_off)),
        turned=_turned(photos, result),
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=[*frame.notes(), *_remarks(stations, photos), *_contradictions(photos, result), *notes],
        coloured_cloud=files,
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"coloured": document.coloured}


def _normals(station: PlacedScan) -> Array:
    """Give the normals of a station's points towards its instrument, in the common frame."""
    normals = point_normals(station.scan)
    if station.scan.sensor_m is None:
        return np.zeros_like(normals)
    away = np.einsum("ij,ij->i", normals, station.scan.points - station.scan.sensor_m) > 0.0
    normals[away] *= -1.0
    return np.ascontiguousarray(station.common_from_scan.rotation.apply(normals))


def _figures(photos: Sequence[PlacedPhoto], result: ColouredCloud) -> list[PhotoFigures]:
    return [
        PhotoFigures(
            station=photo.station,
            name=photo.name,
            shown=count.shown,
            shared=count.shared,
            rms=count.rms if count.shared else None,
            gain=_three(np.exp(result.balance.log_gains[number])),
        )
        for number, (photo, count) in enumerate(zip(photos, result.photos, strict=True))
    ]


def _turned(photos: Sequence[PlacedPhoto], result: ColouredCloud) -> list[PhotoTurnFigures]:
    return [
        PhotoTurnFigures(
            station=turn.station,
            photos=[photos[k].name for k in turn.photos],
            turn_mrad=_three(1e3 * turn.turn_rad),
            turn_std_mrad=_three(1e3 * turn.turn_std_rad),
            shift_px=turn.shift_px,
            statistic=turn.statistic,
            critical=turn.critical,
        )
        for turn in result.turns
    ]


def _contradictions(photos: Sequence[PlacedPhoto], result: ColouredCloud) -> list[str]:
    return [turn.in_words([photo.name for photo in photos]) for turn in result.turns]


def _three(values: Array) -> tuple[float, float, float]:
    red, green, blue = (float(value) for value in values)
    return red, green, blue


def _remarks(stations: Sequence[Json], photos: Sequence[PlacedPhoto]) -> list[str]:
    """Name the stations without photos of their own."""
    with_photos = {photo.station for photo in photos}
    return [f"'{each['name']}' has no photo" for each in stations if each["name"] not in with_photos]


def _write(
    context: StepContext, job_id: str, name: str, frame: CommonFrame, result: ColouredCloud
) -> tuple[list[Artifact], tuple[str, ...]]:
    """Write all stations with their colours into one file."""
    writer = writer_of(name)
    ends = np.cumsum([len(station.scan) for station in frame.stations])[:-1]
    clouds = [
        cloud_in_world(station, frame.origin_m, np.arange(len(station.scan)), station.points(), colors=colors)
        for station, colors in zip(frame.stations, np.split(result.colors, ends), strict=True)
    ]
    filename = f"{frame.file_stem('coloured')}{writer.ending}"
    with output_file(context, job_id, filename) as path:
        written = writer.write(path, clouds, ProgressSection(context.progress, 0.85, 1.0))
    return [artifact(context, job_id, filename, writer.media_type)], written.notes
