"""Process `terrain`: the ground below a registered cloud, and models of heights."""

from collections.abc import Sequence
from dataclasses import dataclass

from algorithms.terrain.options import SlopeFilter
from schemas.requests.terrain_inputs import ClassifiedOutput, TerrainInputs
from schemas.results.terrain_result import TerrainDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import height_faults, posed_station_faults, scan_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
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
            "inputs": {name: value for name, value in inputs.items() if name not in {"stations", "training"}},
            "training": {
                name: scan_of(job, {"scan": scan}, selecting=False)
                for name, scan in (inputs.get("training") or {}).items()
            },
            **about_poses(job),
            "wanted": (job.get("wanted") or {}).get("classified"),
        }
        return [StepCall("terrain", arguments, "finding the ground")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


def _check(inputs: TerrainInputs, stored: Stored) -> None:
    faults = [*posed_station_faults(inputs, stored.files), *height_faults(inputs.stations, stored.files)]
    if inputs.training is not None:
        for name in ("ground", "objects"):
            faults += scan_faults(getattr(inputs.training, name), stored.files, pointer_to("inputs", "training", name))
        chosen = inputs.filter.model_dump()
        if chosen["name"] != SlopeFilter.name:
            why = f"the filter '{chosen['name']}' learns nothing: choose `{SlopeFilter.name}`, or leave this out"
            faults.append(FieldFault("/inputs/training", why))
        elif chosen["allowed_m"] is not None:
            faults.append(FieldFault("/inputs/filter/allowed_m", "it is what `training` tells: give one of them"))
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
