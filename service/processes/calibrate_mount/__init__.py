"""Process `calibrate-mount`: mounts of cameras from edges that scans and photos of the same set-ups show."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.calibrate_mount_inputs import CalibrateMountInputs
from schemas.results.mounts_result import MountsDocument
from service.errors import InvalidRequestError
from service.names.content_keys import content_key
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_stations import station_faults
from service.use_cases.inputs.validate_request import WRONG_FIELDS
from service.use_cases.steps.station_calls import features_call, photos_of
from service.use_cases.steps.step_needs import READS

FEATURES_WEIGHT, MOUNTS_WEIGHT = 2.0, 1.0


@dataclass(frozen=True)
class CalibrateMountPlan:
    """Features of the scans alone, then one step for all photos."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage of `calibrate-mount`."""
        inputs = job["inputs"]
        if len(outputs) == 0:
            alone = [{**station, "photos": []} for station in inputs["stations"]]
            return [features_call(job, station, inputs["features"], None) for station in alone]
        if len(outputs) == 1:
            photos = [photos_of(job, station) for station in inputs["stations"]]
            arguments = {
                "job_id": job["id"],
                "inputs": inputs,
                "features": list(outputs[0]),
                "photos": photos,
                "scans": [job["files"][station["scan"]["file"]]["sha256"] for station in inputs["stations"]],
                # what is always read is named as such
                READS: [content_key(photo["sha256"]) for of_station in photos for photo in of_station],
            }
            return [StepCall("calibrate-mount", arguments, "comparing edges", weight=MOUNTS_WEIGHT)]
        return None

    def total_weight(self, job: Json) -> float:
        """Add up features and comparison."""
        return FEATURES_WEIGHT * len(job["inputs"]["stations"]) + MOUNTS_WEIGHT


def _check(inputs: CalibrateMountInputs, stored: Stored) -> None:
    faults = list(station_faults(inputs.stations, stored.files, "stations"))
    if faults:
        raise InvalidRequestError(WRONG_FIELDS, faults)


CALIBRATE_MOUNT = Process(
    id="calibrate-mount",
    title="Calibrate the mount of a camera from natural edges",
    description="Finds rotation and projection centre of a camera on a scanner from edges that scans and photos of one "
    "or many stations show, without targets: corrections with covariance, a test of the stated mount, what the edges "
    "do not determine and what to add, and a photo list with corrected poses.",
    inputs=CalibrateMountInputs,
    outputs=MountsDocument,
    plan=CalibrateMountPlan(),
    steps={"calibrate-mount": "service.processes.calibrate_mount.comparing:calibrate_mount"},
    check=_check,
)
