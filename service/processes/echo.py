"""Process `echo`: gives back what came in."""

import asyncio
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass

from schemas.requests.echo import EchoInputs
from service.ports import Json, Process, StepCall, StepContext


@dataclass(frozen=True)
class EchoPlan:
    """One step that gives back what it got."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the only stage of `echo`."""
        if outputs:
            return None
        return [StepCall("echo", {"job_id": job["id"], "inputs": job["inputs"]}, "echoing")]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002 - the same for every job
        """Count the only step."""
        return 1.0


def echo(context: StepContext, arguments: Json) -> Json:
    """Write the inputs as the result of the job, after the pause that they may ask for."""
    inputs = arguments["inputs"]
    context.progress.report(0.0, "waiting as the inputs ask")
    time.sleep(inputs.get("pause") or 0)
    context.blobs.write_bytes(f"jobs/{arguments['job_id']}/result.json", json.dumps(inputs).encode())
    return {}


async def answer(inputs: Json) -> Json:
    """Give the inputs at once, after the pause that they may ask for."""
    await asyncio.sleep(inputs.get("pause") or 0)
    return inputs


ECHO = Process(
    id="echo",
    title="Echo",
    description="Gives back its inputs under the same names: for trying a client and for the OGC test suite.",
    inputs=EchoInputs,
    outputs=EchoInputs,
    plan=EchoPlan(),
    steps={"echo": "service.processes.echo:echo"},
    answer=answer,
)
