"""Process `model-planes`: planes under constraints, and their corners."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from schemas.requests.model_planes_inputs import ModelPlanesInputs
from schemas.results.model_planes_result import ModelPlanesDocument
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.station_calls import scan_of


@dataclass(frozen=True)
class ModelPlanesPlan:
    """One step: all stations go in, planes come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `model-planes`."""
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
            **{name: inputs[name] for name in ("cleaning", "planes", "constraints", "corners", "tolerance_m")},
            **about_poses(job),
        }
        return [StepCall("model-planes", arguments, "modelling planes", weight=self.total_weight(job))]

    def total_weight(self, job: Json) -> float:
        """Count the stations."""
        return float(len(job["inputs"]["stations"]))


def _check(inputs: ModelPlanesInputs, stored: Stored) -> None:
    faults = list(_name_faults(inputs))
    faults += posed_station_faults(inputs, stored.files)
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


def _name_faults(inputs: ModelPlanesInputs) -> Iterator[FieldFault]:
    names = [plane.name for plane in inputs.planes]
    for k, name in enumerate(names):
        if name in names[:k]:
            yield FieldFault(f"/inputs/planes/{k}/name", f"the name '{name}' is used twice")
    used = [(f"constraints/{k}/planes", each.planes) for k, each in enumerate(inputs.constraints)]
    used += [(f"corners/{k}", list(each)) for k, each in enumerate(inputs.corners)]
    for where, those in used:
        for number, name in enumerate(those):
            if name not in names:
                yield FieldFault(f"/inputs/{where}/{number}", f"there is no plane '{name}'")


MODEL_PLANES = Process(
    id="model-planes",
    title="Model planes under constraints",
    description="Captures planes of registered scans from seeds on them, adjusts them together so that they keep what "
    "is said of them (vertical, parallel, orthogonal), and intersects them in corners, with covariance.",
    inputs=ModelPlanesInputs,
    outputs=ModelPlanesDocument,
    plan=PosesFirst(ModelPlanesPlan()),
    steps={"model-planes": "service.processes.model_planes.modelling:model_planes"},
    check=_check,
)
