"""Heartbeats, and what happens to the jobs of workers whose heart has stopped."""

import time
from datetime import UTC, datetime, timedelta

import structlog

from service.engine.queue import APPLICATION_VERSION, PROJECT, job_of
from service.engine.tools import Tools
from service.errors import ComputationFailedError, QueueError, to_problem
from service.ports import Job, JobFilter, JobStatus, LogLine

HEARTBEAT_S = 2.0
LEASE_S = 4 * HEARTBEAT_S
UNFINISHED = ("ENQUEUED", "DELAYED", "PENDING")
BROKEN = ("ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
ENDED = ("SUCCESS", "CANCELLED", *BROKEN)
FORGOTTEN_AFTER = timedelta(hours=1)
FORGET_INTERVAL_S = 60.0
FORGOTTEN_AT_ONCE = 500
log = structlog.get_logger()


class Reaper:
    """Takes up what dead workers left. One worker at a time does so, but each is ready to.

    Parameters
    ----------
    tools
        Stores and queue.
    executor_id
        Of this worker.
    """

    def __init__(self, tools: Tools, executor_id: str) -> None:
        self._tools = tools
        self._executor_id = executor_id
        self._seen = self._steady_since = time.monotonic()
        self._next_forgetting = 0.0

    def take_up(self) -> None:
        """Bury the dead, and put what they worked on back on the queue."""
        executors, queue = self._tools.executors, self._tools.queue
        executors.bury_dead(self._executor_id, by_heart=self._may_judge_hearts())
        # only now: what a database that is away refuses was not seen
        self._seen = time.monotonic()
        if not executors.lease("reaper", self._executor_id, LEASE_S):
            return
        # the workflows first: a worker that enters in between must not count as missing
        pending = queue.list(("PENDING",))
        present = set(executors.entered())
        orphans = [workflow for workflow in pending if workflow.executor_id not in present]
        jobs = {job_of(workflow.workflow_id) for workflow in orphans}
        given_up = {job_id for job_id in jobs if not self._count_attempt(job_id)}
        for workflow in orphans:
            if job_of(workflow.workflow_id) not in given_up:
                log.info("taken up again", workflow=workflow.workflow_id, left_by=workflow.executor_id)
                again = LogLine(_now(), "warning", "its worker is gone; taken up again")
                self._tools.log.write(job_of(workflow.workflow_id), [again])
                queue.take_up_again(workflow)
        self._fail_broken()
        self._forget_ended()

    def begin_stale_again(self) -> None:
        """Begin jobs again whose workflow has another version of the order of steps, or was lost."""
        executors, queue = self._tools.executors, self._tools.queue
        if not executors.lease("begin-again", self._executor_id, LEASE_S):
            return
        known = {workflow.workflow_id: workflow for workflow in queue.list(UNFINISHED, name=PROJECT)}
        present = set(executors.entered())
        for job in self._unfinished():
            workflow = known.get(job.id)
            if workflow is None or not (workflow.app_version == APPLICATION_VERSION or workflow.executor_id in present):
                log.info("begun again", job=job.id)
                queue.begin_again(job)

    def _may_judge_hearts(self) -> bool:
        """Tell whether others could have told of their life: after the database was away, or this process was stopped,
        they need time for it.
        """
        now = time.monotonic()
        if now - self._seen > 2.0 * HEARTBEAT_S:
            self._steady_since = now
        return now - self._steady_since > 3.0 * HEARTBEAT_S

    def _unfinished(self) -> "list[Job]":
        statuses = (JobStatus.RUNNING, JobStatus.ACCEPTED)
        found, _ = self._tools.jobs.find(JobFilter(statuses=statuses, limit=self._tools.settings.max_queued_jobs))
        return list(found)

    def _count_attempt(self, job_id: str) -> bool:
        """Count that a worker died of (or with) a job; False when the job will not be tried again."""
        job = self._tools.jobs.get(job_id)
        if job is None or job.status.finished:
            self._tools.queue.cancel(job_id)
            return False
        if job.status is JobStatus.ACCEPTED:
            return True  # its worker died before any step began
        if job.attempts >= self._tools.settings.max_attempts:
            detail = f"the worker died {job.attempts} times during this job; it was last at '{job.message}'"
            self._tools.jobs.fail(job_id, to_problem(ComputationFailedError(detail)), _now())
            self._tools.queue.cancel(job_id)
            return False
        return self._tools.jobs.start(job_id, _now()) is not None

    def _fail_broken(self) -> None:
        """Fail jobs whose workflow broke by a fault of the service itself, so that none stays unfinished for ever."""
        for workflow in self._tools.queue.list(BROKEN, name=PROJECT):
            error = QueueError("the workflow of this job broke; the log of the service has the details")
            self._tools.jobs.fail(workflow.workflow_id, to_problem(error), _now())
            self._tools.queue.cancel(workflow.workflow_id)
            self._tools.queue.forget([workflow.workflow_id])

    def _forget_ended(self) -> None:
        """Remove records of workflows that ended some time ago, a few at a time: the jobs have all that matters."""
        if time.monotonic() < self._next_forgetting:
            return
        self._next_forgetting = time.monotonic() + FORGET_INTERVAL_S
        moment = (_now() - FORGOTTEN_AFTER).isoformat()
        ended = self._tools.queue.list(ENDED, completed_before=moment, limit=FORGOTTEN_AT_ONCE)
        if ended:
            self._tools.queue.forget([workflow.workflow_id for workflow in ended])


def _now() -> datetime:
    return datetime.now(UTC)
