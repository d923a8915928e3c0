"""The job boundary of a worker: what breaks ends one job, and neither the worker nor the others."""

from collections.abc import Coroutine
from datetime import UTC, datetime
from typing import Any

import structlog

from service.engine.patience import DATABASE_ERRORS, patiently, words_of
from service.engine.tools import Tools
from service.errors import QueueError, to_problem

log = structlog.get_logger()


async def within_its_job(tools: Tools, job_id: str, work: Coroutine[Any, Any, None]) -> bool:
    """Do something for a job; a fault of the service itself fails the job, so that none stays unfinished for ever.

    Returns
    -------
    False when the database was away for so long that it is not known what was done.
    """
    try:
        await work
    except DATABASE_ERRORS as error:
        log.warning("a job is left for the moment", job=job_id, error=words_of(error))
        return False
    except Exception:
        log.exception("a job broke", job=job_id)
        problem = to_problem(QueueError("the workflow of this job broke; the log of the service has the details"))
        await patiently(tools.settings.step_timeout_s, tools.jobs.fail, job_id, problem, datetime.now(UTC))
    return True
