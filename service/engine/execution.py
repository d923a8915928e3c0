"""Jobs as durable workflows: what one worker does with them."""

import asyncio
import logging
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

import structlog
from dbos import DBOS, DBOSConfig, SetEnqueueOptions, SetWorkflowID
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as NoConnectionError

from service.engine.patience import Parameters, Value, patiently
from service.engine.queue import APPLICATION_NAME, APPLICATION_VERSION, COMPUTE, PROJECT, JsonSerializer, priority_of
from service.engine.reaper import HEARTBEAT_S, Reaper
from service.engine.tools import Tools
from service.errors import ComputationFailedError, QueueError, StorageError, to_problem
from service.ports import Job, Json, LogLine, StepCall, StepFailedError

RESULT_POLLING_S = 0.1
RESULT_LOOKS_PER_S = 80.0
"""Of all jobs together that wait for steps: each look costs half a millisecond, and sixty jobs that look ten times
a second would take a third of a processor from the computations that they wait for."""
STEP_ATTEMPTS = 3
REPORT_INTERVAL_S = 0.2
DATABASE_ERRORS = (DBAPIError, NoConnectionError, OSError)
log = structlog.get_logger()


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
        self._bells: dict[str, threading.Event] = {}
        self._threads: list[threading.Thread] = []
        self._running: set[asyncio.Task[Json]] = set()
        self._waiting = 0
        self._compute: Any = None
        self._reaper = Reaper(tools, self.executor_id)

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
        self._reaper.begin_stale_again()
        self._reaper.take_up()
        DBOS.launch()
        self._keep("reaper", self._reaper.take_up)
        log.info("worker started", executor=self.executor_id, slots=settings.computations)

    def stop(self) -> None:
        """Give up what is running (its processes are killed), put it back on the queue, and strike this worker out."""
        self._stopping.set()
        for bell in self._bells.values():
            bell.set()
        if self._running:
            loop = next(iter(self._running)).get_loop()
            asyncio.run_coroutine_threadsafe(self._give_up(), loop).result()
        DBOS.destroy(destroy_registry=True)
        for thread in self._threads:
            thread.join()
        try:
            for workflow in self._tools.queue.list(("PENDING",), executor_id=self.executor_id):
                self._tools.queue.take_up_again(workflow)
            self._tools.executors.remove(self.executor_id)
        except DATABASE_ERRORS as error:  # then others find it missing
            log.warning("the database does not answer; jobs are not handed over", error=str(error))
        log.info("worker stopped", executor=self.executor_id)

    def wake(self) -> None:
        """Look at once whether this worker was taken for dead: it was stopped, and goes on."""
        if "heartbeat" in self._bells:
            self._bells["heartbeat"].set()

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
            # the runner's own limit comes first, and waiting for the database; this one is for a runner that hangs
            timeout_seconds=2.0 * self._tools.settings.step_timeout_s + 60.0,
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
        job = await self._kept(tools.jobs.get, job_id)
        if job is None or job.status.finished:
            return
        plan = tools.plans.get(job.process_id)
        if plan is None:
            error = QueueError(f"this worker has no plan for the process '{job.process_id}'")
            await self._kept(tools.jobs.fail, job_id, to_problem(error), _now())
            return
        document = await self._kept(self._document, job)
        outputs: list[Sequence[Json]] = []
        while (stage := plan.next_stage(document, outputs)) is not None:
            weights = [call.weight for call in stage]
            await self._kept(tools.ledger.plan_stage, job_id, len(outputs), weights, plan.total_weight(document))
            results = await self._run_stage(job, len(outputs), stage)
            if results is None:
                return
            outputs.append(results)
        await self._count(job_id)
        await self._kept(tools.jobs.succeed, job_id, _now())

    async def _count(self, job_id: str) -> None:
        """Count what a job has stored, now that nothing more comes; of those that end otherwise, cleaning up does."""
        try:
            await self._kept(self._tools.count_results, job_id)
        except (StorageError, OSError) as error:  # then it is counted when the service cleans up
            log.warning("what a job has stored was not counted", job=job_id, error=str(error))

    async def _run_stage(self, job: Job, stage: int, calls: Sequence[StepCall]) -> Sequence[Json] | None:
        """Run the steps of a stage side by side; None when one of them ended the job."""
        queue = await DBOS.retrieve_queue_async(COMPUTE)
        if queue is None:
            raise QueueError(f"the queue '{COMPUTE}' is not registered")
        handles = []
        for index, call in enumerate(calls):
            with SetWorkflowID(f"{job.id}:{stage}:{index}"), SetEnqueueOptions(priority=priority_of(job)):
                handles.append(
                    await queue.enqueue_async(
                        self._compute, job.id, stage, index, call.name, call.arguments, call.label
                    )
                )
        self._waiting += 1
        try:
            pause_s = max(RESULT_POLLING_S, self._waiting / RESULT_LOOKS_PER_S)
            results = [await handle.get_result(polling_interval_sec=pause_s) for handle in handles]
        finally:
            self._waiting -= 1
        if any("ended" in result for result in results):
            return None
        return [result["output"] for result in results]

    async def _step(self, job_id: str, stage: int, index: int, name: str, arguments: Json, label: str) -> Json:
        """Run one step; all that is logged meanwhile, also what its process says, names job and request."""
        job = await self._kept(self._tools.ledger.begin_step, job_id, label, _now())
        if job is None:
            return {"ended": "the job was over before the step began"}
        with structlog.contextvars.bound_contextvars(job=job_id, request_id=job.request_id):
            return await self._begun_step(job_id, stage, index, name, arguments, label)

    async def _begun_step(self, job_id: str, stage: int, index: int, name: str, arguments: Json, label: str) -> Json:
        """Run one step in a child process; a crash is tried again, a reported error ends the job."""
        await self._note(job_id, f"{label}: begun")
        began = time.monotonic()
        try:
            output = await self._reported(job_id, stage, index, name, arguments, label)
        except StepFailedError as error:
            return await self._end(job_id, error.problem, label)
        except ComputationFailedError as error:
            log.warning("a computing process crashed", step=name, error=str(error))
            await self._note(job_id, f"{label}: {error}", level="warning")
            status = DBOS.step_status
            if status is not None and (status.current_attempt or 0) + 1 < STEP_ATTEMPTS:
                raise
            problem = to_problem(ComputationFailedError(f"{label}: failed {STEP_ATTEMPTS} times: {error}"))
            return await self._end(job_id, problem, label)
        if output is None:
            return {"ended": "the job ended meanwhile"}
        seconds = time.monotonic() - began
        log.info("step done", step=name, label=label, seconds=round(seconds, 3))
        await self._note(job_id, f"{label}: done in {seconds:.1f} s")
        return {"output": output}

    async def _note(self, job_id: str, text: str, level: str = "info") -> None:
        """Write to the job's log, which its owner reads: what computations print stays in the service's."""
        await self._kept(self._tools.log.write, job_id, [LogLine(_now(), level, text)])

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
            return await self._kept(write, job_id, stage, index, fraction, text, _now())

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
        log.warning("a step failed", step=label, problem=problem)
        await self._note(job_id, f"{label}: {problem.get('detail') or problem.get('title')}", level="error")
        if await self._kept(self._tools.jobs.fail, job_id, problem, _now()):
            await self._kept(self._tools.queue.cancel, job_id)
        return {"ended": str(problem.get("title"))}

    def _document(self, job: Job) -> Json:
        """Give what a plan sees of a job."""
        found = {file_id: self._tools.files.get(file_id) for file_id in job.file_ids}
        files = {file_id: file.summary() for file_id, file in found.items() if file is not None}
        of_job = {"id": job.id, "process_id": job.process_id, "inputs": job.inputs, "fetches": list(job.fetches)}
        return {**of_job, "files": files}

    async def _kept(
        self, function: Callable[Parameters, Value], *arguments: Parameters.args, **named: Parameters.kwargs
    ) -> Value:
        """Write to or read from the database, however long it is away."""
        return await patiently(self._tools.settings.step_timeout_s, function, *arguments, **named)

    # heartbeat

    def _keep(self, name: str, action: Callable[[], None]) -> None:
        """Repeat an action in a thread, now and then and when its bell rings, until stopped; a database that is away
        for a while does not end it.
        """
        bell = self._bells[name] = threading.Event()

        def repeat() -> None:
            while True:
                bell.wait(HEARTBEAT_S)
                if self._stopping.is_set():
                    return
                bell.clear()
                try:
                    action()
                except DATABASE_ERRORS as error:
                    log.warning("the database does not answer", thread=name, error=str(error))

        self._threads.append(threading.Thread(target=repeat, name=name, daemon=True))
        self._threads[-1].start()

    def _beat(self) -> None:
        if not self._tools.executors.beat(self.executor_id):
            # others run our jobs already; the computing processes die with this one
            log.critical("this worker was taken for dead and stops", executor=self.executor_id)
            os._exit(70)


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
