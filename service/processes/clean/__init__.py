"""Process `clean`: registered scans without what does not belong to the object."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.clean_inputs import CleanedOutput, CleanInputs
from schemas.cleaning_result import CleaningDocument
from schemas.posed_stations import StationsOfJob
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst
from service.use_cases.steps.station_calls import scan_of

LEAST_CORNERS = 3


@dataclass(frozen=True)
class CleanPlan:
    """One step: all stations go in, what is left of them comes out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `clean`."""
        if outputs:
            return None
        arguments = {
            "job_id": job["id"],
            "stations": [
                {
                    "name": station["name"],
                    "scan": scan_of(job, station),
                    "world_from_scan": station.get("world_from_scan"),
                }
                for station in job["inputs"]["stations"]
            ],
            "options": job["inputs"]["cleaning"],
            "left_out": job.get("left_out", {}),
            "wanted": (job.get("wanted") or {}).get("cleaned"),
        }
        return [StepCall("clean-stations", arguments, "cleaning")]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: CleanInputs, stored: Stored) -> None:
    faults = [*_crop_faults(inputs)]
    if not isinstance(inputs.stations, StationsOfJob):
        faults += posed_station_faults(inputs.stations, stored.files, "stations")
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _crop_faults(inputs: CleanInputs) -> list[FieldFault]:
    """Name crops that enclose nothing, whatever the points are."""
    options, faults = inputs.cleaning, []
    if options.box is not None:
        for axis, low, high in zip("xyz", options.box.lowest_m, options.box.highest_m, strict=True):
            if not low < high:
                faults.append(FieldFault("/inputs/cleaning/box", f"the least {axis} is not below the largest"))
    if options.polygon is not None:
        if len(options.polygon.corners_m) < LEAST_CORNERS:
            few = f"{len(options.polygon.corners_m)} corners enclose nothing; give three or more"
            faults.append(FieldFault("/inputs/cleaning/polygon/corners_m", few))
        floor, ceiling = options.polygon.lowest_m, options.polygon.highest_m
        if floor is not None and ceiling is not None and not floor < ceiling:
            faults.append(FieldFault("/inputs/cleaning/polygon", "the least height is not below the largest"))
    if options.distance is not None and not options.distance.nearest_m < options.distance.farthest_m:
        faults.append(FieldFault("/inputs/cleaning/distance", "the least distance is not below the largest"))
    return faults


CLEAN = Process(
    id="clean",
    title="Clean registered scans",
    description="Crops registered scans, leaves out the points that hang between surfaces and what moved while the "
    "stations were measured, keeps the best view where stations overlap, thins and smooths, and counts what every step "
    "took away.",
    inputs=CleanInputs,
    outputs=CleaningDocument,
    plan=PosesFirst(CleanPlan()),
    steps={"clean-stations": "service.processes.clean.cleaning:clean"},
    check=_check,
    file_outputs={"cleaned": CleanedOutput},
)
