"""The stages before those of a process: files that its request names by their address are fetched and checked."""

from collections.abc import Sequence
from dataclasses import dataclass

from service.ports import Json, Plan, StepCall

FETCH_WEIGHT, CHECK_WEIGHT = 1.0, 0.01


@dataclass(frozen=True)
class FetchingPlan:
    """Fetch the files that a request names by their address, check them, and go on as if they had been uploaded."""

    plan: Plan
    """What comes then."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage: one step for each file to fetch, one that checks all, those of the plan."""
        fetches = job.get("fetches", [])
        if not fetches:
            return self.plan.next_stage(job, outputs)
        if len(outputs) == 0:
            return [
                StepCall(
                    "fetch-file",
                    {"job_id": job["id"], "id": fetch["id"]},
                    f"fetching {fetch['label']}",
                    weight=FETCH_WEIGHT,
                )
                for fetch in fetches
            ]
        if len(outputs) == 1:
            return [StepCall("check-files", {"job_id": job["id"]}, "checking the files", weight=CHECK_WEIGHT)]
        # what the store says now is left aside: it is another thing after the files have come than before
        fetched = {file["id"]: {name: file[name] for name in file if name != "id"} for file in outputs[0]}
        return self.plan.next_stage({**job, "files": {**job["files"], **fetched}}, outputs[2:])

    def total_weight(self, job: Json) -> float:
        """Add the files to fetch to what the plan takes."""
        fetches = len(job.get("fetches", []))
        return self.plan.total_weight(job) + FETCH_WEIGHT * fetches + (CHECK_WEIGHT if fetches else 0.0)
