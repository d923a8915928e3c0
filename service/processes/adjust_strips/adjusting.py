"""The step of `adjust-strips`: read, tie, adjust, compare, describe, write."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int8
from pydantic import TypeAdapter

from algorithms.arrays import Array, Points, Scalars, Vector3
from algorithms.errors import InvalidInputError
from algorithms.progress import ProgressSection
from algorithms.strips.control import ControlPatch
from algorithms.strips.corrections import Correction
from algorithms.strips.determination import determination_of
from algorithms.strips.discrepancies import Discrepancies, cell_for, discrepancies
from algorithms.strips.options import CorrectionOptions, PatchOptions, StripOptions
from algorithms.strips.strip import Strip, Trajectory
from algorithms.strips.strip_block import adjust_strips
from schemas.results.registration_result import Artifact
from service.formats.base import ReadLimits, ScanFile
from service.formats.strips import StripRecords, read_strip, read_trajectory, write_corrected
from service.names.content_keys import content_key
from service.ports import Json, StepContext
from service.processes.adjust_strips.documents import Told, document_of, tables_of
from service.processes.adjust_strips.pictures import pictures_of
from service.processes.adjust_strips.tiles import DividedStrip, divided
from service.use_cases.limits.read_limits import read_limits
from service.use_cases.steps.output_files import artifact, output_file
from service.use_cases.steps.registered_calls import distinct_stems

READ, ADJUSTED, COMPARED = 0.2, 0.65, 0.8
LAZ = "application/vnd.laszip"
OF_DOWNLOADS = re.compile(r"\w[\w .()+-]*")
"""Names that downloads may have, as those of stations."""


@dataclass(frozen=True, eq=False)
class ReadStrips:
    """Strips in one reduced frame, and what was subtracted."""

    strips: Sequence[Strip]
    trajectories: Sequence[str | None]
    """Name of the file of each strip's trajectory."""
    origin_m: Vector3
    origin_s: float
    divided: Sequence[DividedStrip]
    """Of each strip, the points of files that it consists of."""
    remarks: Sequence[str]
    """Points and point sources that take no part."""

    def of_file(self, file: int) -> list[int]:
        """Return the numbers of the strips that have points in a file."""
        return [k for k, strip in enumerate(self.divided) if any(part.file == file for part in strip.parts)]


def adjust_strips_of_job(context: StepContext, arguments: Json) -> Json:
    """Adjust strips, and store document, pictures and corrected strips.

    Raises
    ------
    InvalidInputError
        A strip that is none, a trajectory of another time, or one strip without control.
    TooFewCorrespondencesError
        Too few patches in common.
    NotConvergedError
        The adjustment does not settle.
    """
    job_id, inputs = arguments["job_id"], arguments["inputs"]
    given = read_strips(context, arguments)
    options = StripOptions(
        TypeAdapter(PatchOptions).validate_python(inputs["patches"]),
        TypeAdapter(CorrectionOptions).validate_python(inputs["corrections"]),
        inputs["alpha"],
        inputs["passes"],
    )
    control = control_of(inputs["control"], given.origin_m)
    block = adjust_strips(given.strips, control, options, ProgressSection(context.progress, READ, ADJUSTED))
    corrections = [block.adjusted.block.correction(block.adjusted.state, k) for k in range(len(given.strips))]
    before, after = _compared(context, given, corrections, inputs["picture_cell_m"])
    told = Told(
        strips=given.strips,
        trajectories=given.trajectories,
        origin_m=given.origin_m,
        origin_s=given.origin_s,
        control=control,
        block=block,
        determination=determination_of(block.adjusted, given.strips),
        before=before,
        after=after,
        sources=[each.source for each in given.divided],
        remarks=given.remarks,
        waves_wanted=options.corrections.waves,
    )
    files = tables_of(told) | pictures_of(before, after, inputs["picture_limit_m"])
    for name, (_, data) in files.items():
        context.blobs.write_bytes(f"jobs/{job_id}/artifacts/{name}", data)
    artifacts = [
        Artifact(name=name, type=media, bytes=len(data), href=f"/jobs/{job_id}/artifacts/{name}")
        for name, (media, data) in files.items()
    ]
    document = document_of(told, artifacts, _corrected(context, arguments, given, corrections))
    context.blobs.write_bytes(f"jobs/{job_id}/result.json", document.model_dump_json(by_alias=True).encode())
    return {"patches": document.patches.tied}


def read_strips(context: StepContext, arguments: Json) -> ReadStrips:
    """Read all strips and give each the trajectory that covers it.

    Raises
    ------
    InvalidInputError
        A strip that is none, or that no trajectory covers.
    """
    limits, files = read_limits(context), arguments["strips"]
    records = []
    for number, file in enumerate(files):
        context.progress.report(READ * number / len(files), f"reading {file['name']}")
        records.append(read_strip(context.blobs.local_path(content_key(file["sha256"])), file["filename"], limits))
    first = records[0]
    origin_m = np.rint(first.base_m + first.points.mean(axis=0))
    origin_s = float(np.floor(min(each.gps_time_s[0] for each in records)))
    paths: list[tuple[str, Trajectory]] = []
    for file in arguments["trajectories"]:
        where = context.blobs.local_path(content_key(file["sha256"]))
        unit = arguments["inputs"]["angle_unit"]
        paths.append(
            (file["filename"], read_trajectory(where, file["filename"], file["columns"], unit, origin_m, origin_s))
        )
    parts, remarks = divided(records, [file["name"] for file in files], [file["one_strip"] for file in files])
    strips, names = [], []
    for part in parts:
        points, times, directions = _points_of(records, part, origin_m, origin_s)
        name, path = _covering(paths, times, part.name)
        strips.append(Strip(part.name, points, times, path, directions))
        names.append(name)
    said = [f"{file['name']}: {each.left_out}" for file, each in zip(files, records, strict=True) if each.left_out]
    return ReadStrips(strips, names, origin_m, origin_s, parts, [*said, *remarks])


def _points_of(
    files: Sequence[StripRecords], strip: DividedStrip, origin_m: Vector3, origin_s: float
) -> tuple[Points, Scalars, Int8[Array, "n"] | None]:
    """Return the reduced points of a strip, their times and the directions of the mirror, in the order of times."""
    own = [(files[part.file], part.numbers) for part in strip.parts]
    points = np.concatenate([file.points[numbers] + (file.base_m - origin_m) for file, numbers in own])
    times = np.concatenate([file.gps_time_s[numbers] - origin_s for file, numbers in own])
    given = [None if file.directions is None else file.directions[numbers] for file, numbers in own]
    known = [each for each in given if each is not None]
    directions = np.concatenate(known) if known and len(known) == len(given) else None
    if directions is not None and directions.min() == directions.max():
        directions = None
    if len(own) > 1:
        order = np.argsort(times, kind="stable")
        points, times = points[order], times[order]
        directions = None if directions is None else directions[order]
    return points, times, directions


def _covering(
    paths: Sequence[tuple[str, Trajectory]], times: Scalars, name: str
) -> tuple[str, Trajectory] | tuple[None, None]:
    if not paths:
        return None, None
    for filename, path in paths:
        if path.covers(float(times[0]), float(times[-1])):
            return filename, path
    raise InvalidInputError(
        "trajectories", f"none covers the times of strip {name} without gaps",
        "see that both count the same GPS time, and give the trajectory of its flight",
    )  # fmt: skip


def control_of(points: Sequence[Json], origin_m: Vector3) -> list[ControlPatch]:
    """Join known points of one name to planes."""
    names = list(dict.fromkeys(point["name"] for point in points))
    found = []
    for name in names:
        own = [point for point in points if point["name"] == name]
        places = np.array([[point["x"], point["y"], point["z"]] for point in own], dtype=np.float64) - origin_m
        stds = np.array([np.broadcast_to(point["std_m"], 3) for point in own], dtype=np.float64)
        found.append(ControlPatch(name, places, stds))
    return found


def _compared(
    context: StepContext, given: ReadStrips, corrections: Sequence[Correction], cell_m: float
) -> tuple[Discrepancies, Discrepancies]:
    """Compare the strips with each other as they came, and corrected."""
    context.progress.report(ADJUSTED, "discrepancies before")
    points = [strip.points for strip in given.strips]
    cell = cell_for(points, cell_m)
    before = discrepancies(points, cell)
    context.progress.report(0.5 * (ADJUSTED + COMPARED), "discrepancies after")
    moved = [each.applied(strip.points, strip.times_s) for each, strip in zip(corrections, given.strips, strict=True)]
    return before, discrepancies(moved, cell)


def file_stems(names: Sequence[str]) -> Sequence[str]:
    """Return what the files of strips are called: as the strips, unless one is called as no download can be."""
    return names if all(map(OF_DOWNLOADS.fullmatch, names)) else distinct_stems(names)


def _corrected(
    context: StepContext, arguments: Json, given: ReadStrips, corrections: Sequence[Correction]
) -> list[Artifact] | None:
    """Write the corrected strips, where they are wanted."""
    if arguments["wanted"] is None:
        return None
    files: list[Artifact] = []
    limits: ReadLimits = read_limits(context)
    stems = file_stems([file["name"] for file in arguments["strips"]])
    for number, file in enumerate(arguments["strips"]):
        share = number / len(arguments["strips"])
        context.progress.report(COMPARED + (1.0 - COMPARED) * share, f"writing {file['name']}")
        strips = given.of_file(number)
        source = ScanFile(context.blobs.local_path(content_key(file["sha256"])), file["filename"])

        def moved(points: Points, times: Scalars, sources: Array, strips: Sequence[int] = strips) -> Points:
            corrected = points.copy()
            for strip in strips:
                own = given.divided[strip].owns(times, sources)
                reduced, time = points[own] - given.origin_m, times[own] - given.origin_s
                corrected[own] = corrections[strip].applied(reduced, time) + given.origin_m
            return corrected

        filename = f"{stems[number]}-corrected.laz"
        with output_file(context, arguments["job_id"], filename, source.size) as path:
            write_corrected(source, limits, path, moved)
        files.append(artifact(context, arguments["job_id"], filename, LAZ))
    return files
