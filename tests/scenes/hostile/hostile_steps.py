"""The inspection of uploads as the service runs it, which tells also how much memory it took."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from service.errors import ServiceError, to_problem
from service.ports import Json, StepContext
from service.use_cases.steps.run_features import inspect_uploaded_file


def inspect_and_weigh(context: StepContext, arguments: Json) -> Json:
    """Give what was found or the refusal, the largest growth of resident memory [bytes] and the processor time [s].

    Errors that are no refusals go the way of all errors.
    """
    before = _memory("VmRSS")
    try:
        found = {"found": inspect_uploaded_file(context, arguments)}
    except ServiceError as error:
        found = {"problem": to_problem(error)}
    return {**found, "grown": _memory("VmHWM") - before, "cpu_s": time.process_time()}


def _memory(what: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(what))


STEPS: Mapping[str, Callable[[StepContext, Json], Json]] = {"inspect-file": inspect_and_weigh}
