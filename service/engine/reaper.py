"""What happens to the steps of workers that are gone, and to jobs that nobody leads on."""

import time
from collections.abc import Sequence
from datetime import UTC, datetime

import structlog

from service.engine.tools import Tools
from service.errors import ComputationFailedError, to_problem
from service.ports import LogLine, LostStep

HEARTBEAT_S, REAPING_S = 2.0, 3.0
LEASE_S = 3 * HEARTBEAT_S
WITH_THE_WHOLE_SERVICE = 0.25
"""What the death of a worker counts whose whole service ended with it: that is seldom the fault of what it computed,
yet a step that takes everything down each time must not do so for ever."""
log = structlog.get_logger()


class Reaper:
    """Puts back what dead workers left. Of several, one worker at a time does so, but each is ready to.

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
        self._several = not tools.settings.embedded_database
        self._seen = self._steady_since = time.monotonic()

    def take_up(self) -> Sequence[str]:
        """Bury the dead, and put what they computed back on the queue; give the jobs that nobody leads on."""
        executors, steps = self._tools.executors, self._tools.steps
        leads = self._has("reaper")
        by_heart = self._may_judge_hearts()
        # only now: what a database that is away refuses was not seen
        self._seen = time.monotonic()
        if not leads:
            return ()
        dead = executors.bury_dead(self._executor_id, by_heart=by_heart)
        together = {each.id for each in dead if each.whole_service}
        left = steps.tidy(_now(), by_heart=by_heart)
        for lost in left.steps:
            self._put_back(lost, WITH_THE_WHOLE_SERVICE if lost.executor_id in together else 1.0)
        return left.jobs

    def begin_stale_again(self) -> None:
        """Begin jobs again that were planned in another order of steps."""
        if self._has("begin-again"):
            for job_id in self._tools.steps.begin_stale_again():
                log.info("begun again", job=job_id)

    def _has(self, lease: str) -> bool:
        """Check whether nobody else does the same."""
        return not self._several or self._tools.executors.lease(lease, self._executor_id, LEASE_S)

    def _may_judge_hearts(self) -> bool:
        """Tell whether others could have told of their life: after the database was away, or this process was stopped,
        they need time for it.
        """
        now = time.monotonic()
        if now - self._seen > 2.0 * REAPING_S:
            self._steady_since = now
        return now - self._steady_since > 3.0 * HEARTBEAT_S

    def _put_back(self, lost: LostStep, death: float) -> None:
        """Let another worker compute a step, unless too many have died of it."""
        job_id = lost.place.job_id
        job = self._tools.jobs.get(job_id)
        deaths = self._tools.steps.put_back(lost, death, _now())
        if job is None or deaths == 0.0:
            return
        log.info("taken up again", job=job_id, step=job.message, left_by=lost.executor_id, deaths=deaths)
        if deaths < self._tools.settings.max_attempts:
            self._tools.log.write(job_id, [LogLine(_now(), "warning", "its worker is gone; taken up again")])
            return
        detail = f"the worker died {deaths:g} times during this job; it was last at '{job.message}'"
        self._tools.jobs.fail(job_id, to_problem(ComputationFailedError(detail)), _now())


def _now() -> datetime:
    return datetime.now(UTC)
