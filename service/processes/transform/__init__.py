"""Process `transform`: scans with their poses, in another frame and format."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.transform import TransformDocument, TransformInputs
from service.errors import FieldFault, InvalidRequestError
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import posed_station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS, pointer_to
from service.use_cases.steps.posed_plan import PosesFirst, about_poses
from service.use_cases.steps.registered_calls import registered_calls

REPORT_WEIGHT = 0.1


@dataclass(frozen=True)
class TransformPlan:
    """One step for each file, then the document that lists them."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `transform`."""
        inputs = job["inputs"]
        if not outputs:
            return registered_calls(job, inputs["stations"], inputs)
        if len(outputs) == 1:
            arguments = {
                "job_id": job["id"],
                "inputs": inputs,
                "files": job["files"],
                "written": outputs[0],
                **about_poses(job),
            }
            return [StepCall("report-transform", arguments, "writing the result", weight=REPORT_WEIGHT)]
        return None

    def total_weight(self, job: Json) -> float:
        """Add up stations and report."""
        return len(job["inputs"]["stations"]) + REPORT_WEIGHT


def _check(inputs: TransformInputs, stored: Stored) -> None:
    if not isinstance(inputs.stations, list):  # stations of a job are listed before
        return
    faults = list(posed_station_faults(inputs, stored.files))
    for number, station in enumerate(inputs.stations):
        pose = station.world_from_scan
        if inputs.per_point_std and (pose is None or isinstance(pose, list)):
            why = "`per_point_std` needs a pose with `covariance` or `std`, or that of a job"
            faults.append(FieldFault(pointer_to("inputs", "stations", number, "world_from_scan"), why))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


TRANSFORM = Process(
    id="transform",
    title="Write registered scans",
    description="Writes scans with their poses, or all stations of a finished registration, as files: the uploaded E57 "
    "with new poses and all else byte for byte, or E57, LAZ, COPC, PLY, PCD, PTX, PTS, XYZ, one a station or one with "
    "all, or poses alone for other programs; on request with the standard deviation of every point.",
    inputs=TransformInputs,
    outputs=TransformDocument,
    plan=PosesFirst(TransformPlan()),
    steps={"report-transform": "service.processes.transform.report:report_transform"},
    check=_check,
    needs_open3d=lambda inputs, _wanted: inputs.smooths,
)
