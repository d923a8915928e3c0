"""From stage to stage: what comes next of a job, and how it ends."""

from collections.abc import Sequence
from datetime import UTC, datetime

import structlog

from service.engine.patience import patiently
from service.engine.tools import Tools
from service.errors import QueueError, StorageError, to_problem
from service.ports import Job, Json, Plan

log = structlog.get_logger()


class Leader:
    """Ask the plans of jobs what comes next. Any number of workers may do so for the same job.

    Parameters
    ----------
    tools
        Stores, queue and plans.
    """

    def __init__(self, tools: Tools) -> None:
        self._tools = tools
        self._patience_s = float(tools.settings.step_timeout_s)

    async def lead(self, job_id: str) -> None:
        """Put the next stage of a job on the queue, or end the job, unless a step of it waits or is computed."""
        tools = self._tools
        job = await patiently(self._patience_s, tools.jobs.whole, job_id)
        if job is None or job.status.finished:
            return
        plan = tools.plans.get(job.process_id)
        if plan is None:
            error = QueueError(f"this worker has no plan for the process '{job.process_id}'")
            await patiently(self._patience_s, tools.jobs.fail, job_id, to_problem(error), _now())
            return
        outputs = await patiently(self._patience_s, tools.steps.outputs, job_id)
        if outputs is not None:
            await self._go_on(job, plan, list(outputs))

    async def _go_on(self, job: Job, plan: Plan, outputs: list[Sequence[Json]]) -> None:
        document = await patiently(self._patience_s, self._document, job)
        while (stage := plan.next_stage(document, outputs)) is not None:
            if stage:
                total = plan.total_weight(document)
                await patiently(self._patience_s, self._tools.steps.plan_stage, job.id, len(outputs), stage, total)
                return
            outputs.append([])
        await self._count(job.id)
        await patiently(self._patience_s, self._tools.jobs.succeed, job.id, _now())

    async def _count(self, job_id: str) -> None:
        """Count what a job has stored, now that nothing more comes; of those that end otherwise, cleaning up does."""
        try:
            await patiently(self._patience_s, self._tools.count_results, job_id)
        except (StorageError, OSError) as error:  # then it is counted when the service cleans up
            log.warning("what a job has stored was not counted", job=job_id, error=str(error))

    def _document(self, job: Job) -> Json:
        """Give what a plan sees of a job."""
        found = {file_id: self._tools.files.get(file_id) for file_id in job.file_ids}
        files = {file_id: file.summary() for file_id, file in found.items() if file is not None}
        of_job = {
            "id": job.id,
            "process_id": job.process_id,
            "inputs": job.inputs,
            "fetches": list(job.fetches),
            "created": job.created.isoformat(),
        }
        wanted = (job.wanted or {}).get("files")
        return {**of_job, "files": files, **({"wanted": wanted} if wanted else {})}


def _now() -> datetime:
    return datetime.now(UTC)
