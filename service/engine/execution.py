"""A worker's slots: which steps are computed side by side, from the start of the worker to its end."""

import asyncio
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime

import structlog

from service.engine.boundary import within_its_job
from service.engine.computing import StepComputer
from service.engine.leading import Leader
from service.engine.patience import DATABASE_ERRORS, patiently_at_once, words_of
from service.engine.reaper import HEARTBEAT_S, REAPING_S, Reaper
from service.engine.tools import Tools
from service.ports import ClaimedStep, FreshJob

EMBEDDED_POLLING_S = 0.1
"""Ten looks a second at a database in a file of this machine cost an idle worker 1 % of a processor."""
POLLING_S, IDLE_POLLING_S = 0.1, 0.5
"""Each look at a server is a transaction: only where there was something lately it is looked more often."""
IDLE_AFTER_S = 5.0
log = structlog.get_logger()


class Engine:
    """Compute steps of jobs in this process until stopped.

    Parameters
    ----------
    tools
        Stores, queue, plans and the runner of steps.
    slot
        Name of this worker on its machine.
    launcher
        Process id of who keeps this worker running; None: nobody does.
    """

    def __init__(self, tools: Tools, slot: str, launcher: int | None = None) -> None:
        self._tools = tools
        self._launcher = launcher
        # unique per process: what belongs to a dead worker must not seem to be that of its successor
        self.executor_id = f"{socket.gethostname()}:{slot}:{os.getpid()}:{secrets.token_hex(4)}"
        self._stopping = threading.Event()
        self._bells: dict[str, threading.Event] = {}
        self._threads: list[threading.Thread] = []
        self._loop = asyncio.new_event_loop()
        self._news = asyncio.Event()
        self._running: dict[asyncio.Task[None], ClaimedStep] = {}
        self._left_jobs: set[str] = set()
        self._unsure = False
        self._last_begun = 0.0
        self._leader = Leader(tools)
        self._computer = StepComputer(tools, self.executor_id)
        self._reaper = Reaper(tools, self.executor_id)

    def start(self) -> None:
        """Enter this worker, put back what dead ones left, and begin to work; wait for a database that is away."""
        patience_s = float(self._tools.settings.step_timeout_s)
        patiently_at_once(patience_s, lambda: self._tools.executors.register(self.executor_id, self._launcher))
        self._keep("heartbeat", self._beat, HEARTBEAT_S)
        patiently_at_once(patience_s, self._reaper.begin_stale_again)
        patiently_at_once(patience_s, self._take_up)
        self._threads.append(threading.Thread(target=self._loop.run_until_complete, args=(self._work(),), name="work"))
        self._threads[-1].start()
        self._keep("reaper", self._take_up, REAPING_S)
        log.info("worker started", executor=self.executor_id, slots=self._tools.settings.computations)

    def stop(self) -> None:
        """Give up what is running (its processes are killed), put it back on the queue, and strike this worker out."""
        self._stopping.set()
        for bell in self._bells.values():
            bell.set()
        self._loop.call_soon_threadsafe(self._news.set)
        for thread in self._threads:
            thread.join()
        self._loop.close()
        try:
            self._tools.steps.hand_back(self.executor_id)
            self._tools.executors.remove(self.executor_id)
        except DATABASE_ERRORS as error:  # then others find it missing
            log.warning("the database does not answer; steps are not handed over", error=words_of(error))
        log.info("worker stopped", executor=self.executor_id)

    def wake(self) -> None:
        """Look at once whether this worker was taken for dead: it was stopped, and goes on."""
        if "heartbeat" in self._bells:
            self._bells["heartbeat"].set()

    # slots

    async def _work(self) -> None:
        """Fill the slots whenever one is free and something waits; in the end give up what is computed."""
        while not self._stopping.is_set():
            try:
                await self._fill_slots()
            except DATABASE_ERRORS as error:
                self._unsure = True
                log.warning("the database does not answer; tried again", error=words_of(error))
            with suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), self._pause_s)
            self._news.clear()
        for task in self._running:
            task.cancel()
        if self._running:
            await asyncio.wait(self._running)

    @property
    def _pause_s(self) -> float:
        """How long to wait for news before looking again."""
        if self._tools.settings.embedded_database:
            return EMBEDDED_POLLING_S
        return POLLING_S if time.monotonic() - self._last_begun < IDLE_AFTER_S else IDLE_POLLING_S

    @property
    def _has_room(self) -> bool:
        """Tell whether a step may begin beside those that are computed."""
        suspects = any(step.suspect for step in self._running.values())
        return len(self._running) < self._tools.settings.computations and not suspects

    async def _fill_slots(self) -> None:
        steps = self._tools.steps
        if self._unsure:  # it may be that steps were claimed of which this worker was not told
            kept = [step.place for step in self._running.values()]
            await asyncio.to_thread(steps.hand_back, self.executor_id, kept)
            self._unsure = False
        while self._left_jobs:
            await self._lead(self._left_jobs.pop())
        if not self._has_room or not await asyncio.to_thread(steps.look):
            return
        known: set[str] = set()
        while self._has_room:
            turn = await asyncio.to_thread(steps.take_turn, self.executor_id, _now(), alone=not self._running)
            if isinstance(turn, FreshJob) and turn.id not in known:
                known.add(turn.id)
                await self._lead(turn.id)
            elif isinstance(turn, ClaimedStep):
                self._begin(turn)
            else:
                return

    def _begin(self, step: ClaimedStep) -> None:
        self._last_begun = time.monotonic()
        task = asyncio.create_task(self._compute(step))
        self._running[task] = step
        task.add_done_callback(self._ended)

    def _ended(self, task: "asyncio.Task[None]") -> None:
        del self._running[task]
        self._last_begun = time.monotonic()
        self._news.set()

    async def _compute(self, step: ClaimedStep) -> None:
        """Compute a step and lead its job on, in the same slot: what comes next of it may begin there at once."""
        if not await within_its_job(self._tools, step.place.job_id, self._computer.compute(step)):
            self._unsure = True
        await self._lead(step.place.job_id)

    async def _lead(self, job_id: str) -> None:
        await within_its_job(self._tools, job_id, self._leader.lead(job_id))

    # beside

    def _keep(self, name: str, action: Callable[[], None], every_s: float) -> None:
        """Repeat an action in a thread, now and then and when its bell rings, until stopped; a database that is away
        for a while does not end it.
        """
        bell = self._bells[name] = threading.Event()

        def repeat() -> None:
            while True:
                bell.wait(every_s)
                if self._stopping.is_set():
                    return
                bell.clear()
                try:
                    action()
                except DATABASE_ERRORS as error:
                    log.warning("the database does not answer", thread=name, error=words_of(error))

        self._threads.append(threading.Thread(target=repeat, name=name, daemon=True))
        self._threads[-1].start()

    def _take_up(self) -> None:
        jobs = self._reaper.take_up()
        if jobs and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._left_jobs.update, jobs)

    def _beat(self) -> None:
        if not self._tools.executors.beat(self.executor_id):
            # others compute our steps already; the computing processes die with this one
            log.critical("this worker was taken for dead and stops", executor=self.executor_id)
            os._exit(70)


def _now() -> datetime:
    return datetime.now(UTC)
