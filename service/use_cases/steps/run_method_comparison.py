"""Register a pair by another method than the job's own, to lay what comes out beside it."""

from service.ports import Json, StepContext
from service.use_cases.steps.run_pair import registered_pair


def compare_method(context: StepContext, arguments: Json) -> Json:
    """Store the pair as this method registers it; it takes no part in anything else.

    Parameters
    ----------
    context
        Of the step.
    arguments
        As those of `register-pair`, with the `name` of the method in the comparison.
    """
    registered = registered_pair(context, arguments)
    key = f"jobs/{arguments['job_id']}/methods/{arguments['number']}.json"
    context.blobs.write_bytes(key, registered.document.model_dump_json(by_alias=True).encode())
    return {"pair": key, "method": arguments["name"], **registered.cost()}
