"""Clean the stations of a job, and write the result of `clean`."""

from algorithms.progress import ProgressSection
from schemas.results.cleaning_figures import SmoothingPassFigures
from schemas.results.cleaning_result import CleaningDocument
from schemas.results.registration_result import Artifact
from service.formats.writers import writer_of
from service.ports import Json, StepContext
from service.use_cases.steps.cleaned_clouds import CLEANED, CleanedFrame, cleaned_frame
from service.use_cases.steps.output_files import artifact, output_file


def clean(context: StepContext, arguments: Json) -> Json:
    """Clean, and store document and file.

    Raises
    ------
    InvalidInputError
        A step left no point at all.
    """
    job_id = arguments["job_id"]
    is_wanted = arguments["wanted"] is not None
    cleaned = cleaned_frame(context, arguments["stations"], arguments["options"], attributes=is_wanted)
    files: list[Artifact] | None = None
    notes: tuple[str, ...] = ()
    if is_wanted:
        files, notes = _write(context, job_id, arguments["wanted"]["format"], cleaned)
    document = CleaningDocument(
        points_before=sum(len(station.scan) for station in cleaned.frame.stations),
        points_after=sum(len(station.numbers) for station in cleaned.cleaned.stations),
        steps=cleaned.steps(),
        smoothing=[
            SmoothingPassFigures(
                number=number,
                largest_mm=1e3 * each.largest_m,
                mean_mm=1e3 * each.mean_m,
                std_mm=1e3 * each.std_m,
                removed=each.removed,
                remaining=each.remaining,
            )
            for number, each in enumerate(cleaned.cleaned.smoothing, start=1)
        ],
        left_out=arguments["left_out"],
        poses_from=arguments["poses_from"],
        remarks=[*cleaned.frame.notes(), *cleaned.cleaned.remarks, *notes],
        cleaned=files,
    )
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"points": document.points_after}


def _write(
    context: StepContext, job_id: str, name: str, cleaned: CleanedFrame
) -> tuple[list[Artifact], tuple[str, ...]]:
    """Write what is left of all stations into one file."""
    writer = writer_of(name)
    clouds = [cleaned.cloud(station, left) for station, left in cleaned.stations()]
    filename = f"{cleaned.frame.file_stem('cleaned')}{writer.ending}"
    with output_file(context, job_id, filename) as path:
        written = writer.write(path, clouds, ProgressSection(context.progress, CLEANED, 1.0))
    return [artifact(context, job_id, filename, writer.media_type)], written.notes
