"""Process `calibrate-camera`: interior orientation and mount of a camera from photos of targets."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.calibrate_camera_inputs import CalibrateCameraInputs
from schemas.results.calibration_result import CalibrationDocument
from service.ports import Json, Process, StepCall
from service.processes.calibrate_camera.checking import check_calibration


@dataclass(frozen=True)
class CalibratePlan:
    """One step that finds boards, calibrates and describes."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `calibrate-camera`."""
        if outputs:
            return None
        files = {
            photo["file"]: {key: job["files"][photo["file"]][key] for key in ("name", "sha256")}
            for photo in job["inputs"]["photos"]
        }
        arguments = {"job_id": job["id"], "inputs": job["inputs"], "files": files}
        return [StepCall("calibrate-camera", arguments, "calibrating the camera")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


CALIBRATE_CAMERA = Process(
    id="calibrate-camera",
    title="Calibrate a camera and its mount",
    description="Calibrates a camera from photos of a target field or a board: interior orientation, distortion, and "
    "its mount on a scanner whose head angles are known, with covariance, significance and correlations, the "
    "uncertainty of its projection, halves of the photos against each other, and a test against an earlier "
    "calibration; what the photos do not determine is refused by name.",
    inputs=CalibrateCameraInputs,
    outputs=CalibrationDocument,
    plan=CalibratePlan(),
    steps={"calibrate-camera": "service.processes.calibrate_camera.calibrating:calibrate_camera"},
    check=check_calibration,
)
