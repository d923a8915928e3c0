"""Process `terrain`: the ground below a registered cloud, and models of heights."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.posed_stations import StationsOfJob
from schemas.requests.terrain_inputs import ClassifiedOutput, TerrainInputs
from schemas.results.terrain_result import TerrainDocument
from service.errors import InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst
from service.use_cases.steps.station_calls import scan_of


@dataclass(frozen=True)
class TerrainPlan:
    """One step: all stations go in, classes and models come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `terrain`."""
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
            "left_out": job.get("left_out", {}),
            "wanted": (job.get("wanted") or {}).get("classified"),
        }
        return [StepCall("terrain", arguments, "finding the ground")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


def _check(inputs: TerrainInputs, stored: Stored) -> None:
    if isinstance(inputs.stations, StationsOfJob):
        return
    faults = list(posed_station_faults(inputs.stations, stored.files, "stations"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


TERRAIN = Process(
    id="terrain",
    title="Find the ground and model heights",
    description="Tells the points on the ground of a registered cloud, z upwards, from those on buildings and plants "
    "by one of several filters, compares filters, and makes models of the terrain, of the surface seen from above and "
    "of the heights of objects, with maps of their quality, contour lines, a shaded picture and a mesh.",
    inputs=TerrainInputs,
    outputs=TerrainDocument,
    plan=PosesFirst(TerrainPlan()),
    steps={"terrain": "service.processes.terrain.modelling:model_terrain"},
    check=_check,
    file_outputs={"classified": ClassifiedOutput},
)
