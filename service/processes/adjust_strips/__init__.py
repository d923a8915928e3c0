"""Process `adjust-strips`: strips of airborne scans, tied by what they see in common and corrected together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from schemas.requests.adjust_strips_inputs import (
    LONGEST_PAUSE_S,
    AdjustStripsInputs,
    CorrectedOutput,
    StripFile,
    TrajectoryFile,
)
from schemas.results.strips_result import StripsDocument
from service.errors import FieldFault, InvalidRequestError
from service.names.content_keys import content_key
from service.names.identifiers import is_identifier
from service.ports import Json, Process, StepCall, Stored, StoredFile
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to

ALONE = (
    "one strip alone has nothing to be compared with: give more, a tile whose points name several point sources, or "
    "`control`"
)


@dataclass(frozen=True)
class AdjustStripsPlan:
    """One step: all strips go in, their corrections come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `adjust-strips`."""
        if outputs:
            return None
        inputs = job["inputs"]
        strips = [
            {
                **_file_of(job, strip),
                "name": strip.get("name") or PurePath(job["files"][strip["file"]]["name"]).stem,
                "one_strip": bool(strip.get("one_strip")),
            }
            for strip in inputs["strips"]
        ]
        trajectories = [{**_file_of(job, each), "columns": each.get("columns")} for each in inputs["trajectories"]]
        arguments = {
            "job_id": job["id"],
            "strips": strips,
            "trajectories": trajectories,
            "inputs": {name: value for name, value in inputs.items() if name not in {"strips", "trajectories"}},
            "wanted": (job.get("wanted") or {}).get("corrected"),
            # all of it is read in any case
            "reads": sorted({content_key(each["sha256"]) for each in (*strips, *trajectories)}),
        }
        return [StepCall("adjust-strips", arguments, "adjusting strips", weight=self.total_weight(job))]

    def total_weight(self, job: Json) -> float:
        """Count the strips."""
        return float(len(job["inputs"]["strips"]))


def _file_of(job: Json, reference: Json) -> Json:
    file = job["files"][reference["file"]]
    return {"sha256": file["sha256"], "filename": file["name"]}


def _check(inputs: AdjustStripsInputs, stored: Stored) -> None:
    faults = [*_strip_faults(inputs.strips, stored), *_trajectory_faults(inputs.trajectories, stored)]
    if len(inputs.strips) == 1 and not inputs.control and not _is_tile(inputs.strips[0], stored):
        faults.append(FieldFault("/inputs/strips", ALONE))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _is_tile(strip: StripFile, stored: Stored) -> bool:
    """Tell whether a file holds several strips, or may do so for all that is known: pauses are seen by its points."""
    file = stored.files.get(strip.file)
    if strip.one_strip or file is None or not file.scans:
        return False
    scan = file.scans[0]
    first_s, last_s = scan.get("gps_time_s") or (0.0, 0.0)
    # what was uploaded before the service counted point sources has no such member
    return int(scan.get("point_sources", 2) or 1) > 1 or last_s - first_s > LONGEST_PAUSE_S


def _strip_faults(strips: Sequence[StripFile], stored: Stored) -> Iterator[FieldFault]:
    names: set[str] = set()
    contents: dict[str, str] = {}
    for number, strip in enumerate(strips):
        where = pointer_to("inputs", "strips", number)
        file = stored.files.get(strip.file) if is_identifier(strip.file) else None
        if file is None:
            yield FieldFault(f"{where}/file", f"there is no file '{strip.file}'; POST /files uploads one")
            continue
        name = strip.name or PurePath(file.name).stem
        if name in names:
            yield FieldFault(f"{where}/name", f"the name '{name}' is used twice")
        names.add(name)
        if file.sha256 in contents:
            yield FieldFault(
                f"{where}/file", f"the file '{file.name}' is the same as that of '{contents[file.sha256]}'"
            )
        contents.setdefault(file.sha256, name)
        yield from _reading_faults(file, f"{where}/file")


def _reading_faults(file: StoredFile, where: str) -> Iterator[FieldFault]:
    """Look whether a file is a strip: LAS in metres with times."""
    scan = file.scans[0] if file.scans else None
    if scan is None or file.format != "LAS":
        yield FieldFault(where, f"the file '{file.name}' is no LAS or LAZ: strips need the GPS time of every point")
        return
    if not scan.get("usable", True):
        yield FieldFault(where, f"the points of '{file.name}' cannot be used: {scan.get('reason')}")
    elif scan.get("unit") not in {None, "m"} or scan.get("open_unit"):
        unit = scan.get("unit") or "an unknown unit"
        yield FieldFault(where, f"the file '{file.name}' has its coordinates in {unit}; strips must be in metres")
    # what was uploaded before the service looked at times has no such member
    elif "gps_time_s" in scan and scan["gps_time_s"] is None:
        yield FieldFault(
            where, f"the points of '{file.name}' have no GPS time: write point format 1, 3 or one from 4 to 10"
        )
    elif scan.get("gps_time_s") is not None and scan["gps_time_s"][0] == scan["gps_time_s"][1]:
        yield FieldFault(where, f"all points of '{file.name}' have one GPS time: they are no strip")


def _trajectory_faults(trajectories: Sequence[TrajectoryFile], stored: Stored) -> Iterator[FieldFault]:
    for number, trajectory in enumerate(trajectories):
        where = pointer_to("inputs", "trajectories", number, "file")
        file = stored.files.get(trajectory.file) if is_identifier(trajectory.file) else None
        if file is None:
            yield FieldFault(where, f"there is no file '{trajectory.file}'; POST /files uploads one")
        elif not file.scans or file.scans[0].get("text_columns") is None:
            yield FieldFault(where, f"the file '{file.name}' is no text table of time, x, y, z")


ADJUST_STRIPS = Process(
    id="adjust-strips",
    title="Adjust strips of airborne scans",
    description="Finds planes that overlapping strips of an airborne scan see in common, and corrects every strip by "
    "polynomials in time of shifts and turns, and the bore-sight where trajectories are given, in one adjustment with "
    "control planes and heights; says what the data do not determine and what to add, and shows the discrepancies "
    "before and after.",
    inputs=AdjustStripsInputs,
    outputs=StripsDocument,
    plan=AdjustStripsPlan(),
    steps={"adjust-strips": "service.processes.adjust_strips.adjusting:adjust_strips_of_job"},
    check=_check,
    file_outputs={"corrected": CorrectedOutput},
)
