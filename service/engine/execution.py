"""A worker from its start to its end: it tells others that it lives, takes up what the dead left, and computes."""

import asyncio
import os
import secrets
import socket
import threading
from collections.abc import Callable

import structlog

from service.engine.boundary import within_its_job
from service.engine.computing import StepComputer
from service.engine.leading import Leader
from service.engine.patience import DATABASE_ERRORS, patiently, patiently_at_once, words_of
from service.engine.reaper import HEARTBEAT_S, REAPING_S, Reaper
from service.engine.tools import Tools
from service.ports import ClaimedStep, StepWork

log = structlog.get_logger()


class Engine:
    """Compute steps of jobs in this process until stopped.

    On an embedded database it is the only one: those before it are dead, and nobody has to hear that it lives.

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
        self._leader = Leader(tools)
        self._computer = StepComputer(tools, self.executor_id, self._require_life)
        self._reaper = Reaper(tools, self.executor_id)

    def start(self) -> None:
        """Enter this worker, put back what dead ones left, and begin to work; wait for a database that is away."""
        patience_s = float(self._tools.settings.step_timeout_s)
        patiently_at_once(patience_s, lambda: self._tools.executors.register(self.executor_id, self._launcher))
        several = not self._tools.settings.embedded_database
        if several:
            self._keep("heartbeat", self._beat, HEARTBEAT_S)
        patiently_at_once(patience_s, self._reaper.begin_stale_again)
        patiently_at_once(patience_s, self._take_up)
        work = self._tools.source.run(self.executor_id, StepWork(self._compute, self._lead, self._require_life))
        self._threads.append(threading.Thread(target=self._loop.run_until_complete, args=(work,), name="work"))
        self._threads[-1].start()
        if several:
            self._keep("reaper", self._take_up, REAPING_S)
        log.info("worker started", executor=self.executor_id, slots=self._tools.settings.computations)

    def stop(self) -> None:
        """Give up what is running (its processes are killed), put it back on the queue, and strike this worker out."""
        self._stopping.set()
        for bell in self._bells.values():
            bell.set()
        self._tools.source.stop()
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

    async def _compute(self, step: ClaimedStep) -> bool:
        """Compute a step and lead its job on, in the same slot: what comes next of it may begin there at once."""
        sure = await within_its_job(self._tools, step.place.job_id, self._computer.compute(step))
        await self._lead(step.place.job_id)
        return sure

    async def _lead(self, job_id: str) -> None:
        await within_its_job(self._tools, job_id, self._leader.lead(job_id))

    async def _require_life(self) -> None:
        await patiently(float(self._tools.settings.step_timeout_s), self._beat)

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
        for job_id in self._reaper.take_up():
            if not self._stopping.is_set():
                asyncio.run_coroutine_threadsafe(self._lead(job_id), self._loop)

    def _beat(self) -> None:
        if not self._tools.executors.beat(self.executor_id):
            # others compute our steps already; the computing processes die with this one
            log.critical("this worker was taken for dead and stops", executor=self.executor_id)
            os._exit(70)
