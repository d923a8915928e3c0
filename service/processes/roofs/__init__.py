"""Process `roofs`: buildings over ground plans."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.roofs_inputs import BuildingsOutput, RoofsInputs
from schemas.results.roofs_result import RoofsDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import height_faults, posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import scan_of


@dataclass(frozen=True)
class RoofsPlan:
    """One step: all stations go in, buildings come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `roofs`."""
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
            "plans": inputs["plans"],
            "roof": inputs["roof"],
            "least_plan_m2": inputs["least_plan_m2"],
            **about_poses(job),
            "wanted": (job.get("wanted") or {}).get("building_models"),
        }
        return [StepCall("model-roofs", arguments, "modelling roofs", weight=self.total_weight(job))]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: RoofsInputs, stored: Stored) -> None:
    names = [plan.name for plan in inputs.plans or []]
    faults = [
        FieldFault(f"/inputs/plans/{k}/name", f"the name '{name}' is used twice")
        for k, name in enumerate(names)
        if name in names[:k]
    ]
    faults += posed_station_faults(inputs, stored.files)
    faults += height_faults(inputs.stations, stored.files)
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


ROOFS = Process(
    id="roofs",
    title="Model roofs over ground plans",
    description="Finds the planes of roofs over ground plans as clusters of the parameters of small planes, intersects "
    "them or puts walls where they jump, and gives buildings that enclose a volume, with the points and the fit of "
    "every face.",
    inputs=RoofsInputs,
    outputs=RoofsDocument,
    plan=PosesFirst(RoofsPlan()),
    steps={"model-roofs": "service.processes.roofs.modelling:model_roofs"},
    check=_check,
    file_outputs={"building_models": BuildingsOutput},
)
