"""Give back what came in."""

import json

from service.ports import Json, StepContext


def echo(context: StepContext, arguments: Json) -> Json:
    """Write the inputs as the result of the job."""
    context.blobs.write_bytes(f"jobs/{arguments['job_id']}/result.json", json.dumps(arguments["inputs"]).encode())
    return {}
