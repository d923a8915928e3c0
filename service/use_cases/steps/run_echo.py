"""Give back what came in."""

import json
import time

from service.ports import Json, StepContext


def echo(context: StepContext, arguments: Json) -> Json:
    """Write the inputs as the result of the job, after the pause that they may ask for."""
    inputs = arguments["inputs"]
    context.progress.report(0.0, "waiting as the inputs ask")
    time.sleep(inputs.get("pause") or 0)
    context.blobs.write_bytes(f"jobs/{arguments['job_id']}/result.json", json.dumps(inputs).encode())
    return {}
