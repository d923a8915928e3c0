"""One computation in its own limited process: `python -m service.child`, one JSON request on standard input.

With ``--channel`` it is a nursery instead, of which computations are copies (`service.adapters.processes.nursery`).

Reports go to the file descriptor given, one JSON document per line: ``{"fraction", "message"}`` any number of times,
then ``{"result"}`` or ``{"problem"}``. What libraries print goes to the standard streams and cannot disturb it.
"""

import argparse
import importlib
import json
import logging
import os
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn, cast

from service.adapters.files.handed_files import HandedFiles
from service.adapters.outgoing.remote_sources import RemoteSources
from service.adapters.processes.confinement import confine
from service.adapters.processes.handing import WantedError
from service.adapters.processes.nursery import Kernels, Nursery
from service.adapters.processes.own_user import become_own_user, limit_threads
from service.adapters.processes.process_limits import (
    DEFAULT_STEPS,
    die_with_parent,
    go_first,
    let_others_first,
    limit_resources,
)
from service.errors import ComputationFailedError, to_problem
from service.ports import Json, StepContext
from service.settings import GIGABYTE, Settings
from service.use_cases.limits.machine_shares import machine_shares
from service.use_cases.steps.step_needs import FETCH
from service.use_cases.steps.step_preparation import prepare

REPORT_INTERVAL_S = 0.1
Steps = Mapping[str, Callable[[StepContext, Json], Json]]


class ReportPipe:
    """Send reports to the parent; progress at most ten times a second."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._next = 0.0

    def report(self, fraction: float, message: str) -> None:
        """Say that `fraction` (0..1) of the step is done."""
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + REPORT_INTERVAL_S
            self.send({"fraction": min(max(float(fraction), 0.0), 1.0), "message": message})

    def send(self, document: Json) -> None:
        """Write one line, whole."""
        line = json.dumps(document, allow_nan=False).encode() + b"\n"
        while line:
            line = line[os.write(self._descriptor, line) :]


def run_step(steps: Steps, request: Json, pipe: ReportPipe) -> bool:
    """Run the step and report its result, or its error as a problem document. The job boundary.

    Returns
    -------
    False when the step failed.
    """
    settings = Settings(**request["settings"])
    let_others_first(settings.niceness)
    go_first()
    arguments = request["arguments"]
    memory_bytes = machine_shares(settings).memory_of(request["step"], int(arguments.get("bytes", 0)))
    limit_resources(settings, memory_bytes)
    limits = {name: value for name, value in settings.model_dump().items() if isinstance(value, int)}
    scratch = Path(request["scratch"])
    files = HandedFiles(request["paths"], request["on_request"], scratch)
    context = StepContext(files, pipe, limits, RemoteSources(settings))
    try:
        tempfile.tempdir = str(scratch)
        if settings.confine_children:
            # compiled kernels are read only from then on: who could write them would be in all computations to come
            prepare(request["step"], arguments, pipe)
            limit_threads(is_alone=become_own_user(settings.data_dir))
            confine(
                [Path(path) for path in request["paths"].values()],
                scratch,
                settings.data_dir,
                network=request["step"] == FETCH,
            )
        result = steps[request["step"]](context, arguments)
        pipe.send({"result": result})
    except WantedError as wanted:
        pipe.send({"wanted": wanted.key})
    except MemoryError:
        traceback.print_exc()
        limit = memory_bytes / GIGABYTE
        error = ComputationFailedError(f"the computation needs more than the {limit:.3g} GB of memory it may use")
        pipe.send({"problem": to_problem(error)})
        return False
    except Exception as error:  # noqa: BLE001 - the job boundary: every error becomes a problem document
        traceback.print_exc()
        pipe.send({"problem": to_problem(error)})
        return False
    return True


def load(reference: str) -> Any:
    """Import ``module:attribute``."""
    module, _, attribute = reference.partition(":")
    return getattr(importlib.import_module(module), attribute)


def main() -> None:
    """Read one request from standard input and run it, or be a nursery."""
    parser = argparse.ArgumentParser(prog="service.child", description="Run one computation (started by a worker).")
    parser.add_argument("--steps", default=DEFAULT_STEPS)
    parser.add_argument("--parent", type=int, required=True)
    parser.add_argument("--report-fd", type=int)
    parser.add_argument("--channel", type=int, help="descriptor of the socket over which a nursery takes orders")
    parser.add_argument("--warm-up", default="", help="module:function by which a nursery loads libraries")
    parser.add_argument("--later", default="", help="module:function by which it loads more while the first step runs")
    parser.add_argument("--practice", default="", help="module:function by which a copy of it compiles kernels")
    parser.add_argument("--kernels", default="", help="module:function by which it loads them in the end")
    parser.add_argument("--rest", default="", help="module:function by which another copy compiles what few need")
    parser.add_argument("--niceness", type=int, default=0, help="how far a nursery steps back while it compiles")
    options = parser.parse_args()
    die_with_parent(options.parent)
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr)
    if options.channel is not None:
        _be_a_nursery(options)
    request = json.loads(sys.stdin.buffer.readline())
    done = run_step(cast("Steps", load(options.steps)), request, ReportPipe(options.report_fd))
    sys.stdout.flush()
    sys.stderr.flush()
    # threads of C++ libraries sometimes hang or crash at exit; the result is safe, so nothing is waited for
    os._exit(0 if done else 1)


def _be_a_nursery(options: argparse.Namespace) -> NoReturn:
    """Load what computations need, and start them as ordered."""
    steps = cast("Steps", load(options.steps))
    if options.warm_up:
        load(options.warm_up)()
    later = load(options.later) if options.later else None
    names = options.practice, options.kernels, options.rest
    kernels = Kernels(*(load(name) if name else None for name in names))

    def compute(request: Json, reports: int) -> bool:
        return run_step(steps, request, ReportPipe(reports))

    with socket.socket(fileno=options.channel) as channel:
        Nursery(channel, compute, later, kernels, options.niceness).serve()
    os._exit(0)


if __name__ == "__main__":
    main()
