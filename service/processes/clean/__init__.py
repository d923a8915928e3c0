"""Process `clean`: registered scans without what does not belong to the object."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.clean_inputs import CleanedOutput, CleanInputs
from schemas.results.cleaning_result import CleaningDocument
from service.errors import InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import scan_of


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
            **about_poses(job),
            "wanted": (job.get("wanted") or {}).get("cleaned"),
        }
        return [StepCall("clean-stations", arguments, "cleaning")]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: CleanInputs, stored: Stored) -> None:
    faults = list(posed_station_faults(inputs, stored.files))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


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
    needs_open3d=lambda inputs, _wanted: inputs.cleaning.smoothing is not None,
    file_outputs={"cleaned": CleanedOutput},
)
