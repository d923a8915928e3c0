"""One step from its beginning to its end, on the worker that has it."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime

import structlog

from service.engine.patience import patiently
from service.engine.tools import Tools
from service.errors import ComputationFailedError, to_problem
from service.ports import ClaimedStep, Json, LogLine, StepFailedError

STEP_ATTEMPTS = 3
REPORT_INTERVAL_S = 0.2
LOOK_INTERVAL_S = 0.5
"""How often it is looked whether a step of which nothing is heard is still wanted: a cancelled one ends within 1 s."""
PAUSE_S = 0.5
"""Before a computation that crashed is tried again."""
log = structlog.get_logger()


class StepComputer:
    """Compute steps in processes of their own, and write down how far they are and what comes out.

    Parameters
    ----------
    tools
        Stores and the runner of steps.
    executor_id
        Of this worker.
    require_life
        Ends this process if others took it for dead; asked when a step is not wanted of it any more.
    """

    def __init__(self, tools: Tools, executor_id: str, require_life: Callable[[], Awaitable[None]]) -> None:
        self._tools = tools
        self._executor_id = executor_id
        self._require_life = require_life
        self._patience_s = float(tools.settings.step_timeout_s)

    async def compute(self, step: ClaimedStep) -> None:
        """Compute a step; all that is logged meanwhile, also what its process says, names job and request.

        Cancelled, it kills its process, and the step stays this worker's until it is handed back.
        """
        with structlog.contextvars.bound_contextvars(job=step.place.job_id, request_id=step.request_id):
            await self._note(step, "begun")
            began = time.monotonic()
            try:
                output = await self._output(step)
            except StepFailedError as error:
                await self._fail(step, error.problem)
                return
            except ComputationFailedError as error:
                detail = f"{step.label}: failed {STEP_ATTEMPTS} times: {error}"
                await self._fail(step, to_problem(ComputationFailedError(detail)))
                return
            if output is None:
                await self._require_life()
                return
            finish = self._tools.steps.finish_step
            if await patiently(self._patience_s, finish, step.place, self._executor_id, output, _now()):
                seconds = time.monotonic() - began
                log.info("step done", step=step.name, label=step.label, seconds=round(seconds, 3))
                await self._note(step, f"done in {seconds:.1f} s")
            else:
                await self._require_life()

    async def _output(self, step: ClaimedStep) -> Json | None:
        """Give what comes out, None when nobody wants it any more; a crash is tried again."""
        for attempt in range(1, STEP_ATTEMPTS + 1):
            try:
                return await self._reported(step)
            except StepFailedError:
                raise
            except ComputationFailedError as error:
                log.warning("a computing process crashed", step=step.name, error=str(error))
                await self._note(step, str(error), level="warning")
                if attempt == STEP_ATTEMPTS:
                    raise
            await asyncio.sleep(PAUSE_S)
        return None

    async def _reported(self, step: ClaimedStep) -> Json | None:
        """Run the child and write its progress down a few times a second; None when the job ended meanwhile."""
        heard: list[tuple[float, str]] = []
        run = asyncio.create_task(
            self._tools.runner.run(
                step.name,
                step.arguments,
                timeout_s=self._patience_s,
                on_progress=lambda fraction, text: heard.append((fraction, text)),
            )
        )
        latest, written = (0.0, ""), time.monotonic()
        try:
            while not run.done():
                await asyncio.wait({run}, timeout=REPORT_INTERVAL_S)
                news = bool(heard)
                latest = heard[-1] if news else latest
                heard.clear()
                if news or time.monotonic() - written > LOOK_INTERVAL_S:
                    if not await self._written(step, *latest):
                        return None
                    written = time.monotonic()
            return run.result()
        finally:
            if not run.done():
                run.cancel()
                await asyncio.wait({run})

    async def _written(self, step: ClaimedStep, fraction: float, message: str) -> bool:
        """Write down how far a step is; False when nobody wants it any more."""
        text = f"{step.label}: {message}" if message else step.label
        write = self._tools.steps.report_step
        return await patiently(self._patience_s, write, step.place, self._executor_id, fraction, text, _now())

    async def _fail(self, step: ClaimedStep, problem: Json) -> None:
        """Fail the job; its other steps are given up by who computes them."""
        log.warning("a step failed", step=step.label, problem=problem)
        await self._note(step, str(problem.get("detail") or problem.get("title")), level="error")
        await patiently(self._patience_s, self._tools.jobs.fail, step.place.job_id, problem, _now())

    async def _note(self, step: ClaimedStep, text: str, level: str = "info") -> None:
        """Write to the job's log, which its owner reads: what computations print stays in the service's."""
        line = LogLine(_now(), level, f"{step.label}: {text}")
        await patiently(self._patience_s, self._tools.log.write, step.place.job_id, [line])


def _now() -> datetime:
    return datetime.now(UTC)
