"""The only place that knows the queue engine (DBOS Transact).

A job is a durable workflow on the queue ``project``, which holds no processor: it asks the job's plan for the next
stage and puts each step of it on the queue ``compute`` as a workflow of its own. A step runs in a child process. What
finished is recorded and never repeated; what a dead worker left is taken up by another.
"""

import asyncio
import json
import logging
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
import structlog
from dbos import DBOS, DBOSClient, DBOSConfig, EnqueueOptions, Serializer, SetWorkflowID, WorkflowStatus
from sqlalchemy.exc import DBAPIError

from service.errors import ComputationFailedError, QueueError, to_problem
from service.ports import (
    ExecutorRegistry,
    FileStore,
    Job,
    JobFilter,
    JobLog,
    JobStatus,
    JobStore,
    Json,
    LogLine,
    Plan,
    StepCall,
    StepFailedError,
    StepLedger,
    StepRunner,
)
from service.settings import Settings

APPLICATION_NAME = "tieline"
APPLICATION_VERSION = "1"
"""Changed only when the order of steps in a workflow changes; jobs of other versions are begun again at start."""
PROJECT, COMPUTE = "project", "compute"
PROJECT_CONCURRENCY = 64
POLLING_S = {PROJECT: 0.5, COMPUTE: 0.1}
"""Many steps take less than a second, so that waiting for the next look at their queue would double them. Ten looks a
second cost an idle worker 2 % of a processor."""
RESULT_POLLING_S = 0.1
CLIENT_CONNECTIONS = 2
HEARTBEAT_S = 2.0
STEP_ATTEMPTS = 3
REPORT_INTERVAL_S = 0.2
UNFINISHED = ("ENQUEUED", "DELAYED", "PENDING")
BROKEN = ("ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED")
log = structlog.get_logger()


class JsonSerializer(Serializer):
    """Keep workflow data as JSON, so that no pickle is ever read."""

    def serialize(self, data: Any) -> str:
        """Write JSON; an exception becomes its text."""
        return json.dumps(data, default=lambda value: {"__error__": repr(value)})

    def deserialize(self, serialized_data: str) -> Any:
        """Read JSON; the text of an exception becomes a `QueueError`."""
        return json.loads(serialized_data, object_hook=_revived)

    def name(self) -> str:
        """Name the format in the database."""
        return "tieline_json"


def _revived(document: Json) -> Any:
    return QueueError(document["__error__"]) if set(document) == {"__error__"} else document


def prepare(settings: Settings) -> None:
    """Make or update the engine's tables and queues; once, after the metadata's migrations, before any process."""
    DBOS.migrate(settings.sqlalchemy_url)
    client = _client(settings)
    try:
        _register_queues(client, settings)
    finally:
        client.destroy()


def _client(settings: Settings) -> DBOSClient:
    return DBOSClient(
        system_database_url=settings.sqlalchemy_url,
        system_database_pool_size=CLIENT_CONNECTIONS,
        serializer=JsonSerializer(),
        application_name=APPLICATION_NAME,
        lazy=True,
        retry_connection_errors=False,  # a request is answered that the database is away
    )


def _register_queues(client: DBOSClient, settings: Settings) -> None:
    for name, concurrency in ((PROJECT, PROJECT_CONCURRENCY), (COMPUTE, settings.computations)):
        client.register_queue(name, worker_concurrency=concurrency, polling_interval_sec=POLLING_S[name])


class DbosQueue:
    """Put jobs on the queue and take them off; in the web process as in a worker."""

    def __init__(self, settings: Settings, executors: ExecutorRegistry) -> None:
        self._client = _client(settings)
        self._executors = executors

    def enqueue(self, connection: sa.Connection, job: Job) -> None:
        """Enqueue a job within the transaction of a connection to the same database."""
        self._client.enqueue_in_transaction(connection, _enqueueing(job.id), job.id)

    def cancel(self, job_id: str) -> None:
        """Ask that a job's computation stop (within 5 s)."""
        self._client.cancel_workflow(job_id, cancel_children=True)

    def live_workers(self) -> int:
        """Count workers whose heart beats."""
        return len(self._executors.live())

    def take_up_again(self, workflow: WorkflowStatus) -> None:
        """Put a workflow whose worker is gone back on its queue; its finished steps stay finished."""
        self._client.resume_workflow(workflow.workflow_id, queue_name=workflow.queue_name or _queue_of(workflow))

    def list(self, states: Sequence[str], **conditions: Any) -> list[WorkflowStatus]:
        """List workflows without their data."""
        return self._client.list_workflows(status=list(states), load_input=False, load_output=False, **conditions)

    def begin_again(self, job_id: str) -> None:
        """Forget what was recorded of a job and enqueue it as if it were new."""
        self._client.delete_workflows([job_id], delete_children=True)
        self._client.enqueue(_enqueueing(job_id), job_id)

    def close(self) -> None:
        """Close the connections."""
        self._client.destroy()


def _enqueueing(job_id: str) -> EnqueueOptions:
    return {
        "workflow_name": PROJECT,
        "queue_name": PROJECT,
        "workflow_id": job_id,
        "app_version": APPLICATION_VERSION,
    }


def _queue_of(workflow: WorkflowStatus) -> str:
    return PROJECT if workflow.name == PROJECT else COMPUTE


def _job_of(workflow_id: str) -> str:
    """Give the job of a workflow: steps are called ``<job>:<stage>:<index>``."""
    return workflow_id.partition(":")[0]


@dataclass(frozen=True)
class Tools:
    """What the engine works with."""

    settings: Settings
    jobs: JobStore
    ledger: StepLedger
    log: JobLog
    files: FileStore
    executors: ExecutorRegistry
    runner: StepRunner
    plans: Mapping[str, Plan]
    queue: DbosQueue


class Engine:
    """Execute jobs in this process until stopped. One per process, because DBOS is.

    Parameters
    ----------
    tools
        Stores, queue, plans and the runner of steps.
    slot
        Name of this worker on its machine.
    """

    def __init__(self, tools: Tools, slot: str) -> None:
        self._tools = tools
        # unique per process: two live workers sharing an id would run a job twice
        self.executor_id = f"{socket.gethostname()}:{slot}:{os.getpid()}:{secrets.token_hex(4)}"
        self._stopping = threading.Event()
        self._threads: list[threading.Thread] = []
        self._running: set[asyncio.Task[Json]] = set()
        self._compute: Any = None

    def start(self) -> None:
        """Enter this worker, take up what dead ones left, and begin to work."""
        settings, executors = self._tools.settings, self._tools.executors
        executors.register(self.executor_id)
        config: DBOSConfig = {
            "name": APPLICATION_NAME,
            "system_database_url": settings.sqlalchemy_url,
            "application_version": APPLICATION_VERSION,
            "executor_id": self.executor_id,
            "serializer": JsonSerializer(),
            "log_level": "WARNING",
            "run_migrations": False,
            "sys_db_pool_size": settings.database_connections,
        }
        DBOS(config=config)
        _join_log()
        self._define_workflows()
        self._keep("heartbeat", self._beat)
        self._begin_stale_again()
        self._take_up()
        DBOS.launch()
        self._keep("reaper", self._take_up)
        log.info("worker started", executor=self.executor_id, slots=settings.computations)

    def stop(self) -> None:
        """Give up what is running (its processes are killed), put it back on the queue, and strike this worker out."""
        self._stopping.set()
        if self._running:
            loop = next(iter(self._running)).get_loop()
            asyncio.run_coroutine_threadsafe(self._give_up(), loop).result()
        DBOS.destroy(destroy_registry=True)
        for thread in self._threads:
            thread.join()
        for workflow in self._tools.queue.list(("PENDING",), executor_id=self.executor_id):
            self._tools.queue.take_up_again(workflow)
        self._tools.executors.remove(self.executor_id)
        log.info("worker stopped", executor=self.executor_id)

    async def _give_up(self) -> None:
        """Stop the running computations; their workflows stay pending, to be taken up again."""
        tasks = list(self._running)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    # workflows

    def _define_workflows(self) -> None:
        """Tell the engine what it runs. Functions and not methods, because the decorators mark what they are given."""

        @DBOS.workflow(name=PROJECT, max_recovery_attempts=None)
        async def project(job_id: str) -> None:
            await self._project(job_id)

        @DBOS.step(
            name="step",
            preemptible=True,
            retries_allowed=True,
            max_attempts=STEP_ATTEMPTS,
            interval_seconds=0.5,
            should_retry=lambda error: isinstance(error, ComputationFailedError),
            # the runner's own limit comes first; this one is for a runner that hangs
            timeout_seconds=self._tools.settings.step_timeout_s + 60.0,
        )
        async def step(job_id: str, stage: int, index: int, name: str, arguments: Json, label: str) -> Json:
            return await self._step(job_id, stage, index, name, arguments, label)

        @DBOS.workflow(name=COMPUTE, max_recovery_attempts=None)
        async def compute(job_id: str, stage: int, index: int, name: str, arguments: Json, label: str) -> Json:
            return await step(job_id, stage, index, name, arguments, label)

        self._compute = compute

    async def _project(self, job_id: str) -> None:
        """Lead a job through its stages. Replayed after a crash: must do the same again."""
        tools = self._tools
        job = await asyncio.to_thread(tools.jobs.get, job_id)
        if job is None or job.status.finished:
            return
        plan = tools.plans.get(job.process_id)
        if plan is None:
            error = QueueError(f"this worker has no plan for the process '{job.process_id}'")
            await asyncio.to_thread(tools.jobs.fail, job_id, to_problem(error), _now())
            return
        document = await asyncio.to_thread(self._document, job)
        outputs: list[Sequence[Json]] = []
        while (stage := plan.next_stage(document, outputs)) is not None:
            weights = [call.weight for call in stage]
            await asyncio.to_thread(tools.ledger.plan_stage, job_id, len(outputs), weights, plan.total_weight(document))
            results = await self._run_stage(job_id, len(outputs), stage)
            if results is None:
                return
            outputs.append(results)
        await asyncio.to_thread(tools.jobs.succeed, job_id, _now())

    async def _run_stage(self, job_id: str, stage: int, calls: Sequence[StepCall]) -> Sequence[Json] | None:
        """Run the steps of a stage side by side; None when one of them ended the job."""
        queue = await DBOS.retrieve_queue_async(COMPUTE)
        if queue is None:
            raise QueueError(f"the queue '{COMPUTE}' is not registered")
        handles = []
        for index, call in enumerate(calls):
            with SetWorkflowID(f"{job_id}:{stage}:{index}"):
                handles.append(
                    await queue.enqueue_async(
                        self._compute, job_id, stage, index, call.name, call.arguments, call.label
                    )
                )
        results = [await handle.get_result(polling_interval_sec=RESULT_POLLING_S) for handle in handles]
        if any("ended" in result for result in results):
            return None
        return [result["output"] for result in results]

    async def _step(self, job_id: str, stage: int, index: int, name: str, arguments: Json, label: str) -> Json:
        """Run one step in a child process; a crash is tried again, a reported error ends the job."""
        tools = self._tools
        if not await asyncio.to_thread(tools.ledger.begin_step, job_id, label, _now()):
            return {"ended": "the job was over before the step began"}
        await self._note(job_id, f"{label}: begun")
        began = time.monotonic()
        try:
            output = await self._reported(job_id, stage, index, name, arguments, label)
        except StepFailedError as error:
            return await self._end(job_id, error.problem, label)
        except ComputationFailedError as error:
            log.warning("a computing process crashed", job=job_id, step=name, error=str(error))
            await self._note(job_id, f"{label}: {error}", level="warning")
            status = DBOS.step_status
            if status is not None and (status.current_attempt or 0) + 1 < STEP_ATTEMPTS:
                raise
            problem = to_problem(ComputationFailedError(f"{label}: failed {STEP_ATTEMPTS} times: {error}"))
            return await self._end(job_id, problem, label)
        if output is None:
            return {"ended": "the job ended meanwhile"}
        await self._note(job_id, f"{label}: done in {time.monotonic() - began:.1f} s")
        return {"output": output}

    async def _note(self, job_id: str, text: str, level: str = "info") -> None:
        """Write to the job's log, which its owner reads: what computations print stays in the service's."""
        await asyncio.to_thread(self._tools.log.write, job_id, [LogLine(_now(), level, text)])

    async def _reported(
        self, job_id: str, stage: int, index: int, name: str, arguments: Json, label: str
    ) -> Json | None:
        """Run the child and write its progress down a few times a second; None when the job ended meanwhile."""
        heard: list[tuple[float, str]] = []
        timeout_s = float(self._tools.settings.step_timeout_s)
        if self._stopping.is_set():
            raise asyncio.CancelledError
        run = asyncio.create_task(
            self._tools.runner.run(
                name, arguments, timeout_s=timeout_s, on_progress=lambda fraction, text: heard.append((fraction, text))
            )
        )
        self._running.add(run)
        run.add_done_callback(self._running.discard)

        async def written(fraction: float, message: str) -> bool:
            text = f"{label}: {message}" if message else label
            write = self._tools.ledger.report_step
            return await asyncio.to_thread(write, job_id, stage, index, fraction, text, _now())

        try:
            while not run.done():
                await asyncio.wait({run}, timeout=REPORT_INTERVAL_S)
                latest = heard[-1:]
                heard.clear()
                if latest and not await written(*latest[0]):
                    return None
            output = run.result()
            return output if await written(1.0, "") else None
        finally:
            if not run.done():
                run.cancel()
                await asyncio.wait({run})

    async def _end(self, job_id: str, problem: Json, label: str) -> Json:
        """Fail the job, and stop its other steps."""
        log.warning("a step failed", job=job_id, step=label, problem=problem)
        await self._note(job_id, f"{label}: {problem.get('detail') or problem.get('title')}", level="error")
        if await asyncio.to_thread(self._tools.jobs.fail, job_id, problem, _now()):
            await asyncio.to_thread(self._tools.queue.cancel, job_id)
        return {"ended": str(problem.get("title"))}

    def _document(self, job: Job) -> Json:
        """Give what a plan sees of a job."""
        found = {file_id: self._tools.files.get(file_id) for file_id in job.file_ids}
        files = {file_id: file.summary() for file_id, file in found.items() if file is not None}
        return {"id": job.id, "process_id": job.process_id, "inputs": job.inputs, "files": files}

    # heartbeat and reaper

    def _keep(self, name: str, action: Callable[[], None]) -> None:
        """Repeat an action in a thread until stopped; a database that is away for a while does not end it."""

        def repeat() -> None:
            while not self._stopping.wait(HEARTBEAT_S):
                try:
                    action()
                except (DBAPIError, OSError) as error:
                    log.warning("the database does not answer", thread=name, error=str(error))

        self._threads.append(threading.Thread(target=repeat, name=name, daemon=True))
        self._threads[-1].start()

    def _beat(self) -> None:
        if not self._tools.executors.beat(self.executor_id):
            # others run our jobs already; the computing processes die with this one
            log.critical("this worker was taken for dead and stops", executor=self.executor_id)
            os._exit(70)

    def _take_up(self) -> None:
        """Take up what dead workers left; one worker at a time does this."""
        executors, queue = self._tools.executors, self._tools.queue
        executors.bury_dead(self.executor_id)
        if not executors.lease("reaper", self.executor_id, 4 * HEARTBEAT_S):
            return
        # the workflows first: a worker that enters in between must not count as missing
        pending = queue.list(("PENDING",))
        present = set(executors.entered())
        orphans = [workflow for workflow in pending if workflow.executor_id not in present]
        jobs = {_job_of(workflow.workflow_id) for workflow in orphans}
        given_up = {job_id for job_id in jobs if not self._count_attempt(job_id)}
        for workflow in orphans:
            if _job_of(workflow.workflow_id) not in given_up:
                log.info("taken up again", workflow=workflow.workflow_id, left_by=workflow.executor_id)
                again = LogLine(_now(), "warning", "its worker is gone; taken up again")
                self._tools.log.write(_job_of(workflow.workflow_id), [again])
                queue.take_up_again(workflow)
        self._fail_broken()

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
        running, _ = self._tools.jobs.find(JobFilter(statuses=(JobStatus.RUNNING, JobStatus.ACCEPTED), limit=1000))
        ids = [job.id for job in running]
        for workflow in self._tools.queue.list(BROKEN, workflow_ids=ids) if ids else ():
            error = QueueError("the workflow of this job broke; the log of the service has the details")
            self._tools.jobs.fail(workflow.workflow_id, to_problem(error), _now())
            self._tools.queue.cancel(workflow.workflow_id)

    def _begin_stale_again(self) -> None:
        """Begin jobs again whose workflow has another version of the order of steps, or was lost."""
        executors, queue = self._tools.executors, self._tools.queue
        if not executors.lease("begin-again", self.executor_id, 4 * HEARTBEAT_S):
            return
        unfinished, _ = self._tools.jobs.find(
            JobFilter(statuses=(JobStatus.RUNNING, JobStatus.ACCEPTED), limit=self._tools.settings.max_queued_jobs)
        )
        known = {workflow.workflow_id: workflow for workflow in queue.list(UNFINISHED, name=PROJECT)}
        present = set(executors.entered())
        for job in unfinished:
            workflow = known.get(job.id)
            if workflow is None or not (workflow.app_version == APPLICATION_VERSION or workflow.executor_id in present):
                log.info("begun again", job=job.id)
                queue.begin_again(job.id)


def _join_log() -> None:
    """Let the engine's records go where all others go, except those of orderly cancellations."""
    logger = logging.getLogger("dbos")
    logger.handlers.clear()
    logger.propagate = True
    logger.addFilter(_is_not_about_cancelling)


def _is_not_about_cancelling(record: logging.LogRecord) -> bool:
    kind = record.exc_info[0] if record.exc_info else None
    text = record.getMessage()
    return not (
        (kind is not None and kind.__name__.endswith("WorkflowCancelledError"))
        or text.startswith("Asyncio task cancelled")
        or "no longer owned by this execution" in text
        or "was cancelled during execution" in text
    )


def _now() -> datetime:
    return datetime.now(UTC)
