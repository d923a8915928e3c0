"""Process `detect-edges`: straight edges of one photo."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.detect_edges_inputs import DetectEdgesInputs
from schemas.results.edges_result import EdgesDocument
from service.ports import Json, Process, StepCall, Stored
from service.use_cases.inputs.check_photos import check_photo


@dataclass(frozen=True)
class DetectEdgesPlan:
    """One step: a photo goes in, its edges come out."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `detect-edges`."""
        if outputs:
            return None
        file = job["files"][job["inputs"]["photo"]["file"]]
        arguments = {
            "job_id": job["id"],
            "inputs": job["inputs"],
            "filename": file["name"],
            "sha256": file["sha256"],
        }
        return [StepCall("detect-edges", arguments, f"edges of {file['name']}")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


def _check(inputs: DetectEdgesInputs, stored: Stored) -> None:
    check_photo(inputs.photo, stored.files)


DETECT_EDGES = Process(
    id="detect-edges",
    title="Detect straight edges in a photo",
    description="Finds straight 2-D edges in one photo and measures them to a part of a pixel, with covariance, the "
    "longest first; with the camera given, lens distortion is removed from them.",
    inputs=DetectEdgesInputs,
    outputs=EdgesDocument,
    plan=DetectEdgesPlan(),
    steps={"detect-edges": "service.processes.detect_edges.detection:detect_edges_of_photo"},
    check=_check,
)
