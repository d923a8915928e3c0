"""Collect what several methods made of the pairs of a job."""

from collections.abc import Sequence

from schemas.results.method_comparison import MethodComparison
from schemas.results.registration_result import Pair
from service.ports import Json, StepContext
from service.use_cases.documents.method_comparison_documents import MethodOnPair, method_comparison


def compared_methods(context: StepContext, arguments: Json, pairs: Sequence[Pair]) -> MethodComparison | None:
    """Lay the methods of a job side by side; None where none were to be compared.

    Parameters
    ----------
    context
        Of the step.
    arguments
        Of `report-registration`.
    pairs
        Those of the job's own method as the result has them, in the order of the outputs.
    """
    if "compared" not in arguments:
        return None
    inputs = arguments["inputs"]
    own = inputs["method"]["method"]
    return method_comparison(
        [_of_output(own, pair, output) for pair, output in zip(pairs, arguments["pairs"], strict=True)],
        [
            _of_output(
                output["method"],
                Pair.model_validate_json(context.blobs.local_path(output["pair"]).read_bytes()),
                output,
            )
            for output in arguments["compared"]
        ],
        inputs["stations"][0]["name"],
        inputs.get("reference"),
    )


def _of_output(method: str, pair: Pair, output: Json) -> MethodOnPair:
    x, y, z = output["centre_m"]
    return MethodOnPair(method, pair, output["seconds"], output["peak_memory_bytes"], (x, y, z))
