"""Process `adjust`: scans, photos, control and fictitious observations in one least squares adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.adjust_inputs import AdjustInputs
from schemas.results.adjust_result import AdjustDocument
from service.ports import Json, Process, StepCall
from service.processes.adjust.checking import check_network


@dataclass(frozen=True)
class AdjustPlan:
    """One step that adjusts, tests and describes."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `adjust`."""
        if outputs:
            return None
        return [StepCall("adjust", {"job_id": job["id"], "inputs": job["inputs"]}, "adjusting the network")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


ADJUST = Process(
    id="adjust",
    title="Adjust a hybrid network",
    description="Adjusts polar, image, coordinate, distance, height and inclinometer observations, control, and "
    "fictitious observations together: stations, photos, points, cameras and mounts with covariance, without "
    "approximate values where they are missing, in a free or given datum; gross errors are searched for, standard "
    "deviations of groups estimated on request, and every observation is tested with its reliability.",
    inputs=AdjustInputs,
    outputs=AdjustDocument,
    plan=AdjustPlan(),
    steps={"adjust": "service.processes.adjust.adjusting:adjust"},
    check=check_network,
    document_inputs=("network", "epoch"),
)
