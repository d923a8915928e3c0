"""Steps and plans with known behaviour, for the tests of the engine."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from algorithms.errors import InvalidInputError
from service.ports import Json, StepCall, StepContext
from tests.integration.stopping_transactions import stop_when_told

stop_when_told()

PRACTISING = "practising"
"""File in which a test says how practising goes."""


def trace(arguments: Json, event: str) -> None:
    with Path(arguments["trace"]).open("a") as file:
        file.write(f"{event} {arguments['name']} {os.getpid()} {time.time()}\n")


def practise() -> None:
    """Tell who practises, and take the time, or fail, as the test wishes."""
    folder = Path(os.environ["TMPDIR"])
    wish = (folder / PRACTISING).read_text() if (folder / PRACTISING).exists() else ""
    with (folder / "practised").open("a") as file:
        file.write(f"{os.getpid()} {os.getppid()} {Path('/proc/self/comm').read_text()}")
    time.sleep(60.0 if wish == "takes long" else 0.0)
    if wish == "fails":
        raise RuntimeError("no compiler")


def nap(context: StepContext, arguments: Json) -> Json:
    """Sleep and tell of it; noise on standard output must not disturb the reports."""
    trace(arguments, "start")
    print('{"result": "not this one"}', flush=True)
    begin = time.monotonic()
    while (passed := time.monotonic() - begin) < arguments["seconds"]:
        context.progress.report(passed / arguments["seconds"], "napping")
        time.sleep(0.02)
    trace(arguments, "end")
    return {"name": arguments["name"]}


def nap_with_company(context: StepContext, arguments: Json) -> Json:
    """Sleep, with a process of its own and a scratch directory."""
    other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    (context.blobs.scratch() / "half-done").write_text("x")
    Path(arguments["pids"]).write_text(f"{os.getpid()} {other.pid}")
    return nap(context, arguments)


def crash(_context: StepContext, arguments: Json) -> Json:
    trace(arguments, "start")
    print("the roof is on fire", file=sys.stderr, flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)
    return {}


def poison(_context: StepContext, arguments: Json) -> Json:
    """Take the worker down: the parent of the process of which this one is a copy."""
    trace(arguments, "start")
    nursery = psutil.Process().parent()
    worker = None if nursery is None else nursery.parent()
    assert worker is not None
    worker.kill()
    time.sleep(60)
    return {}


def refuse(_context: StepContext, arguments: Json) -> Json:
    trace(arguments, "start")
    raise InvalidInputError("the scan", "has no points")


def hog(_context: StepContext, _arguments: Json) -> Json:
    return {"bytes": len(bytearray(3_000_000_000))}


def burst(_context: StepContext, _arguments: Json) -> Json:
    raise RuntimeError("a secret of the implementation")


def store(context: StepContext, arguments: Json) -> Json:
    """Leave a download."""
    context.blobs.write_bytes(f"jobs/{arguments['job_id']}/artifacts/{arguments['name']}", b"1" * arguments["bytes"])
    return {}


STEPS = {
    "store": store,
    "nap": nap,
    "nap-with-company": nap_with_company,
    "crash": crash,
    "poison": poison,
    "refuse": refuse,
    "hog": hog,
    "burst": burst,
}


class ListedPlan:
    """Run the stages that the inputs list."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        stages = job["inputs"]["stages"]
        if len(outputs) == len(stages):
            return None
        return [StepCall(step["step"], {**step, "job_id": job["id"]}, step["name"]) for step in stages[len(outputs)]]

    def total_weight(self, job: Json) -> float:
        return float(sum(len(stage) for stage in job["inputs"]["stages"]))


PLANS = {"listed": ListedPlan()}
