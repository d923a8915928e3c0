"""Process `drainage`: where water runs on a terrain, and the structure lines that follow from it."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.drainage_inputs import DrainageInputs
from schemas.results.drainage_result import DrainageDocument
from service.errors import InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import height_faults, posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import scan_of


@dataclass(frozen=True)
class DrainagePlan:
    """One step: all stations go in, grids and lines come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `drainage`."""
        if outputs:
            return None
        inputs = job["inputs"]
        arguments = {
            "job_id": job["id"],
            "stations": [
                {
                    "name": station["name"],
                    "scan": scan_of(job, station),
                    "world_from_scan": station.get("world_from_scan"),
                }
                for station in inputs["stations"]
            ],
            "inputs": {name: value for name, value in inputs.items() if name != "stations"},
            **about_poses(job),
        }
        return [StepCall("drainage", arguments, "raining")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


def _check(inputs: DrainageInputs, stored: Stored) -> None:
    faults = [*posed_station_faults(inputs, stored.files), *height_faults(inputs.stations, stored.files)]
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


DRAINAGE = Process(
    id="drainage",
    title="Let it rain on a terrain",
    description="Makes a terrain of a registered cloud, z upwards, and gives its slope, aspect and curvature, its "
    "hollows, what runs off when it rains everywhere, and valleys, ridges and paths between hollows as lines.",
    inputs=DrainageInputs,
    outputs=DrainageDocument,
    plan=PosesFirst(DrainagePlan()),
    steps={"drainage": "service.processes.drainage.raining:let_it_rain"},
    check=_check,
)
