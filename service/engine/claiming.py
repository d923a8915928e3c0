"""A worker's slots where it asks for its steps: which are computed side by side, from its start to its end."""

import asyncio
import time
from contextlib import suppress
from datetime import UTC, datetime

import structlog

from service.engine.patience import DATABASE_ERRORS, words_of
from service.ports import ClaimedStep, FreshJob, StepRecords, StepWork, Turns
from service.settings import Settings

EMBEDDED_POLLING_S = 0.1
"""Ten looks a second at a database in a file of this machine cost an idle worker 1 % of a processor."""
POLLING_S, IDLE_POLLING_S = 0.1, 0.5
"""Each look at a server is a transaction: only where there was something lately it is looked more often."""
IDLE_AFTER_S = 5.0
log = structlog.get_logger()


class ClaimedSteps:
    """Claim steps whenever a slot is free and something waits.

    Parameters
    ----------
    settings
        How many slots there are.
    turns, steps
        The queue, and what is kept of it.
    """

    def __init__(self, settings: Settings, turns: Turns, steps: StepRecords) -> None:
        self._slots = settings.computations
        self._embedded = settings.embedded_database
        self._turns = turns
        self._steps = steps
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping = False
        self._news = asyncio.Event()
        self._running: dict[asyncio.Future[bool], ClaimedStep] = {}
        self._unsure = False
        self._last_begun = 0.0

    async def run(self, executor_id: str, work: StepWork) -> None:
        """Fill the slots until told to stop; then give up what is computed."""
        self._loop = asyncio.get_running_loop()
        while not self._stopping:
            try:
                await self._fill_slots(executor_id, work)
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

    def stop(self) -> None:
        """End `run`, from any thread."""
        self._stopping = True
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._news.set)

    @property
    def _pause_s(self) -> float:
        """How long to wait for news before looking again."""
        if self._embedded:
            return EMBEDDED_POLLING_S
        return POLLING_S if time.monotonic() - self._last_begun < IDLE_AFTER_S else IDLE_POLLING_S

    @property
    def _has_room(self) -> bool:
        """Check whether a step may begin beside those that are computed."""
        suspects = any(step.suspect for step in self._running.values())
        return len(self._running) < self._slots and not suspects

    async def _fill_slots(self, executor_id: str, work: StepWork) -> None:
        if self._unsure:  # it may be that steps were claimed of which this worker was not told
            kept = [step.place for step in self._running.values()]
            await asyncio.to_thread(self._steps.hand_back, executor_id, kept)
            left = await asyncio.to_thread(self._steps.tidy, _now())
            self._unsure = False
            for job_id in left.jobs:
                await work.lead(job_id)
        if not self._has_room or not await asyncio.to_thread(self._turns.look):
            return
        known: set[str] = set()
        while self._has_room:
            turn = await asyncio.to_thread(self._turns.take_turn, executor_id, _now(), alone=not self._running)
            if isinstance(turn, FreshJob) and turn.id not in known:
                known.add(turn.id)
                await work.lead(turn.id)
            elif isinstance(turn, ClaimedStep):
                self._begin(turn, work)
            else:
                return

    def _begin(self, step: ClaimedStep, work: StepWork) -> None:
        self._last_begun = time.monotonic()
        task = asyncio.ensure_future(work.compute(step))
        self._running[task] = step
        task.add_done_callback(self._ended)

    def _ended(self, task: "asyncio.Future[bool]") -> None:
        del self._running[task]
        self._unsure |= not task.cancelled() and not task.result()
        self._last_begun = time.monotonic()
        self._news.set()


def _now() -> datetime:
    return datetime.now(UTC)
