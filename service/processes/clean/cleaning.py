"""Clean the stations of a job, and write the result of `clean`."""

import numpy as np
from pydantic import TypeAdapter

from algorithms.cleaning.cleaned_stations import CleanedStations, clean_stations
from algorithms.cleaning.options import CleaningOptions
from algorithms.progress import ProgressSection
from schemas.cleaning_result import CleaningDocument, CleaningStep, SmoothingPassFigures
from schemas.registration_result import Artifact
from service.formats.writers import ScalarField, writer_of
from service.ports import Json, StepContext
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.placed_stations import CommonFrame, cloud_in_world, read_stations

MOVED_CLASS = 64
"""Class of points that other stations looked through; the first that LAS leaves to its users."""
CLASSES = ScalarField("classification", "class, 64: moved object", "u1")


def clean(context: StepContext, arguments: Json) -> Json:
    """Clean, and store document and file.

    Raises
    ------
    InvalidInputError
        A step left no point at all.
    """
    job_id = arguments["job_id"]
    options = TypeAdapter(CleaningOptions).validate_python(arguments["options"])
    frame = read_stations(context, arguments["stations"])
    cleaned = clean_stations(frame.stations, frame.origin_m, options, ProgressSection(context.progress, 0.2, 0.85))
    files: list[Artifact] | None = None
    notes: tuple[str, ...] = ()
    if arguments["wanted"] is not None:
        files, notes = _write(context, job_id, arguments["wanted"]["format"], frame, cleaned)
    document = CleaningDocument(
        points_before=sum(len(station.scan) for station in frame.stations),
        points_after=sum(len(station.numbers) for station in cleaned.stations),
        steps=[
            CleaningStep(
                step=count.step,
                station=count.station,
                before=count.before,
                removed=count.removed,
                marked=count.marked,
                after=count.before - count.removed,
            )
            for count in cleaned.steps
        ],
        smoothing=[
            SmoothingPassFigures(
                number=number,
                largest_mm=1e3 * each.largest_m,
                mean_mm=1e3 * each.mean_m,
                std_mm=1e3 * each.std_m,
                removed=each.removed,
                remaining=each.remaining,
            )
            for number, each in enumerate(cleaned.smoothing, start=1)
        ],
        left_out=arguments["left_out"],
        remarks=[*cleaned.remarks, *notes],
        cleaned=files,
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"points": document.points_after}


def _write(
    context: StepContext, job_id: str, name: str, frame: CommonFrame, cleaned: CleanedStations
) -> tuple[list[Artifact], tuple[str, ...]]:
    """Write what is left of all stations into one file."""
    writer = writer_of(name)
    clouds = [
        cloud_in_world(
            station,
            frame.origin_m,
            left.numbers,
            left.points,
            scalars={CLASSES.name: np.where(left.moved, MOVED_CLASS, 0).astype(np.uint8)},
            fields=(CLASSES,),
        )
        for station, left in zip(frame.stations, cleaned.stations, strict=True)
        if len(left.numbers)
    ]
    filename = f"cleaned{writer.ending}"
    with output_file(context, job_id, filename) as path:
        written = writer.write(path, clouds, ProgressSection(context.progress, 0.85, 1.0))
    return [artifact(context, job_id, filename, writer.media_type)], written.notes
