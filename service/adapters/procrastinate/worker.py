"""A worker's slots where Procrastinate gives it steps: the only module that knows this library's own code.

The library locks, wakes, orders and aborts. What it has no word for stands here: a step that may take its worker down
is computed alone; what is given back at the end is at once another worker's; a database that is away is waited for.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from typing import Any, LiteralString, TypeVar, cast

import structlog
from procrastinate import App, JobContext, PsycopgConnector, RetryDecision
from procrastinate.connector import Notify
from procrastinate.exceptions import ConnectorException, ProcrastinateException
from procrastinate.jobs import Job
from procrastinate.retry import BaseRetryStrategy
from procrastinate.worker import Worker
from psycopg import Error as DriverError
from psycopg import InterfaceError, OperationalError

from service.adapters.database.given import ALONE, STEPS
from service.adapters.database.tables import PATIENCE
from service.ports import StepPlace, StepRecords, StepWork
from service.settings import Settings

BEAT_S = 2.0
POLLING_S = 5.0
"""Beside being told."""
LOOK_AFTER_S = 30.0
"""How often it is looked whether the queue believes that this worker computes what it does not."""
NEVER_S = 1e9
KEPT_S = 86_400.0
"""So long is it known which workers of the library there were; one that could not beat for a while goes on."""
AWAY = (ProcrastinateException, DriverError, OSError)
NEXT = "SELECT queue_name FROM procrastinate_jobs WHERE status = 'todo' ORDER BY priority DESC, id LIMIT 1"
DOING = "SELECT id, worker_id FROM procrastinate_jobs WHERE status = 'doing' AND worker_id = ANY(%(workers)s)"
TOLD = "SELECT pg_notify(%(channel)s, json_build_object('type', 'job_inserted', 'job_id', %(id)s::bigint)::text)"
Value = TypeVar("Value")
log = structlog.get_logger()


class HandedBackError(Exception):
    """Let the library give a step to another worker, at once."""


class _AtOnce(BaseRetryStrategy):
    """Defer again what was handed back, and what broke: it is recorded elsewhere how often steps are tried."""

    def get_retry_decision(self, *, exception: BaseException, job: Job) -> RetryDecision | None:  # noqa: ARG002
        return None if isinstance(exception, asyncio.CancelledError) else RetryDecision()


class GivenSteps:
    """Compute the steps that Procrastinate gives.

    Parameters
    ----------
    settings
        How many slots there are, and where the database is.
    steps
        What is kept of steps.
    """

    _work: StepWork

    def __init__(self, settings: Settings, steps: StepRecords) -> None:
        self._settings = settings
        self._steps = steps
        self._stopping = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._workers: list[Worker] = []
        self._running: dict[asyncio.Task[Any], tuple[int, StepPlace | None]] = {}
        self._executor_id = ""
        self._connector = PatientConnector(settings)
        self._app = App(connector=self._connector)
        self._app.task(name="compute", queue=STEPS, pass_context=True, retry=_AtOnce())(self._compute)
        self._app.task(name="lead", queue=STEPS, pass_context=True, retry=_AtOnce())(self._lead)

    async def run(self, executor_id: str, work: StepWork) -> None:
        """Let steps be computed until told to stop; then hand back what is computed."""
        self._loop, self._executor_id, self._work = asyncio.get_running_loop(), executor_id, work
        logging.getLogger("procrastinate").setLevel(logging.ERROR)  # what happens to steps is told by the engine
        while not self._stopping:
            try:
                async with self._app.open_async():
                    await self._beside(self._serve())
            except AWAY as error:
                log.warning("the queue does not answer; tried again", error=str(error.__cause__ or error))
                await asyncio.sleep(1.0)

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stopping = True
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._give_up)

    def _give_up(self) -> None:
        self._connector.patient = False
        for worker in self._workers:
            worker.stop()
        for task in self._running:
            task.cancel()

    # workers of the library

    async def _serve(self) -> None:
        """Run one worker of the library after the other."""
        while not self._stopping:
            alone = await self._suspect_is_next()
            worker = Worker(
                self._app,
                queues=[ALONE if alone else STEPS],
                concurrency=1 if alone else self._settings.computations,
                wait=not alone,
                fetch_job_polling_interval=POLLING_S,
                abort_job_polling_interval=POLLING_S,
                listen_notify=True,
                delete_jobs="always",
                install_signal_handlers=False,
                update_heartbeat_interval=NEVER_S,
                stalled_worker_timeout=KEPT_S,
            )
            self._workers.append(worker)
            try:
                await worker.run()
            except AWAY as error:
                log.warning("the queue does not answer; tried again", error=str(error.__cause__ or error))
                await asyncio.sleep(1.0)
            finally:
                self._workers.remove(worker)
        for queue in (STEPS, ALONE):  # the library tells nobody of what is there again
            await self._app.connector.execute_query_async(TOLD, channel=f"procrastinate_queue_v1#{queue}", id=0)

    async def _beside(self, serving: Coroutine[Any, Any, None]) -> None:
        tasks = [
            asyncio.ensure_future(self._repeat(*each)) for each in ((self._beat, BEAT_S), (self._look, LOOK_AFTER_S))
        ]
        try:
            await serving
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _repeat(self, action: Callable[[], Awaitable[None]], every_s: float) -> None:
        while True:
            await asyncio.sleep(every_s)
            try:
                await action()
            except AWAY as error:
                log.warning("the queue does not answer", error=str(error.__cause__ or error))

    async def _beat(self) -> None:
        """Say that the library's workers of this process live, also while one stops; let a suspect be alone soon."""
        for worker in self._workers:
            if worker.worker_id is not None:
                await self._app.job_manager.update_heartbeat(worker.worker_id)
        if any(worker.wait for worker in self._workers) and await self._suspect_is_next():
            for worker in self._workers:
                worker.stop()

    async def _suspect_is_next(self) -> bool:
        rows = await self._app.connector.execute_query_all_async(NEXT)
        return bool(rows) and rows[0]["queue_name"] == ALONE

    async def _look(self) -> None:
        """Give to others what the queue believes that this process computes, and it does not: its end was not noted."""
        for row in await self._strays():
            await asyncio.sleep(BEAT_S)
            if row in await self._strays():
                await self._app.job_manager.retry_job_by_id_async(row, datetime.now(UTC))

    async def _strays(self) -> list[int]:
        ids = [worker.worker_id for worker in self._workers if worker.worker_id is not None]
        rows = await self._app.connector.execute_query_all_async(DOING, workers=ids)
        known = {library_id for library_id, _ in self._running.values()}
        return [row["id"] for row in rows if row["id"] not in known]

    # what is given

    async def _compute(self, context: JobContext, *, job: str, stage: int, position: int) -> None:
        """Compute a step, unless it is over, and lead its job on."""
        place = StepPlace(job, stage, position)
        await self._until_cancelled(context, place, self._computed(place))

    async def _lead(self, context: JobContext, *, job: str) -> None:
        """Lead a job on."""
        await self._until_cancelled(context, None, self._led(job))

    async def _computed(self, place: StepPlace) -> None:
        begin = partial(self._steps.begin_step, place, self._executor_id, datetime.now(UTC))
        step = await _to_its_end(asyncio.to_thread(begin))
        if step is None:
            await self._led(place.job_id)
        elif not await self._work.compute(step):
            raise HandedBackError(place)

    async def _led(self, job_id: str) -> None:
        await self._work.lead(job_id)
        # the library would note the end of what another worker has
        await self._work.require_life()

    async def _until_cancelled(
        self, context: JobContext, place: StepPlace | None, work: Coroutine[Any, Any, None]
    ) -> None:
        """Do something; when it does not end well while the job is wanted, another worker is to have it."""
        task = cast("asyncio.Task[Any]", asyncio.current_task())
        self._running[task] = (context.job.id or 0, place)
        try:
            await work
        except asyncio.CancelledError:
            if not self._stopping:
                raise  # the job is over
            await self._hand_back(task)
            raise HandedBackError(place) from None
        except Exception:
            await self._hand_back(task)
            raise
        finally:
            del self._running[task]

    async def _hand_back(self, task: "asyncio.Task[Any]") -> None:
        """Put a step back before the queue gives it to another worker, who would take it for computed."""
        kept = [place for other, (_, place) in self._running.items() if place is not None and other is not task]
        with suppress(Exception):  # a database that is away finds this worker missing
            await asyncio.to_thread(self._steps.hand_back, self._executor_id, kept)


async def _to_its_end(doing: Coroutine[Any, Any, Value]) -> Value:
    """Wait for what a thread does also when cancelled: it is done anyhow."""
    task = asyncio.ensure_future(doing)
    try:
        return await asyncio.shield(task)
    except asyncio.CancelledError:
        await asyncio.wait({task})
        raise


class PatientConnector(PsycopgConnector):
    """Wait for a database that is away: else the library's worker ends, and begins nothing while its steps go on.

    Parameters
    ----------
    settings
        Where it is.
    """

    def __init__(self, settings: Settings) -> None:
        address = settings.sqlalchemy_url.replace("+psycopg", "", 1)
        super().__init__(
            conninfo=address, min_size=1, max_size=2, timeout=5.0, reconnect_timeout=2.0, kwargs=dict(PATIENCE)
        )
        self.patient = True

    async def execute_query_async(self, query: LiteralString, **arguments: Any) -> None:
        """Do something."""
        await self._patiently(super().execute_query_async, query, arguments)

    async def execute_query_one_async(self, query: LiteralString, **arguments: Any) -> dict[str, Any]:
        """Ask for one row."""
        return await self._patiently(super().execute_query_one_async, query, arguments)

    async def execute_query_all_async(self, query: LiteralString, **arguments: Any) -> list[dict[str, Any]]:
        """Ask for all rows."""
        return await self._patiently(super().execute_query_all_async, query, arguments)

    async def listen_notify(self, on_notification: Notify, channels: Iterable[str]) -> None:
        """Listen, for as long as nobody ends it."""
        while True:
            try:
                await super().listen_notify(on_notification, channels)
            except ConnectorException as error:
                log.warning("the queue does not tell what is new; tried again", error=str(error.__cause__ or error))
            await asyncio.sleep(1.0)

    async def _patiently(
        self, ask: Callable[..., Awaitable[Value]], query: LiteralString, arguments: dict[str, Any]
    ) -> Value:
        """Ask again while the database is away; what was done, and its answer lost, does no harm twice."""
        while True:
            try:
                return await ask(query, **arguments)
            except ConnectorException as error:
                if not self.patient or not isinstance(error.__cause__, (OperationalError, InterfaceError)):
                    raise
                log.warning("the queue does not answer; tried again", error=str(error.__cause__))
            await asyncio.sleep(1.0)
