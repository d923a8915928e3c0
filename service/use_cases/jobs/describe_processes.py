"""The processes that are offered, and their descriptions from the models of their inputs and outputs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from schemas.base import RequestModel
from schemas.detect_edges_inputs import DetectEdgesInputs
from schemas.echo import EchoInputs
from schemas.edges_result import EdgesDocument
from schemas.execution import ExecuteRequest
from schemas.extract_lines_inputs import ExtractLinesInputs
from schemas.lines_result import LinesDocument
from schemas.processes import InputDescription, JobControlOption, OutputDescription
from schemas.register_inputs import RegisterInputs
from schemas.registration_result import RegistrationDocument
from service.errors import NoSuchProcessError
from service.use_cases.inputs.schema_dialect import CONTENT, KEPT, as_openapi_30


@dataclass(frozen=True)
class OfferedProcess:
    """One process as clients see it."""

    id: str
    title: str
    description: str
    inputs: type[RequestModel]
    outputs: type[BaseModel]
    job_control: tuple[JobControlOption, ...] = ("async-execute", "dismiss")
    version: str = "1.0.0"

    @property
    def request_model(self) -> type[ExecuteRequest[Any]]:
        """Give the model of an execution request."""
        return ExecuteRequest.__class_getitem__(self.inputs)  # type: ignore[return-value]

    @property
    def synchronous(self) -> bool:
        """Tell whether it may answer at once."""
        return "sync-execute" in self.job_control


_OFFERED = (
    OfferedProcess(
        "register",
        "Register scans",
        "Finds how two or more terrestrial laser scans lie to each other from the straight lines, planes and cylinders "
        "in them and the edges in photos taken with them, without a first guess, and says how well each parameter is "
        "known or that it is not determined.",
        RegisterInputs,
        RegistrationDocument,
    ),
    OfferedProcess(
        "extract-lines",
        "Extract lines from a scan and its photos",
        "Finds straight 3-D lines of one station with covariance: intersections of planes and axes of cylinders in the "
        "scan, and edges that only photos taken there show.",
        ExtractLinesInputs,
        LinesDocument,
    ),
    OfferedProcess(
        "detect-edges",
        "Detect straight edges in a photo",
        "Finds straight 2-D edges in one photo and measures them to a part of a pixel, with covariance, the longest "
        "first; with the camera given, lens distortion is removed from them.",
        DetectEdgesInputs,
        EdgesDocument,
    ),
    OfferedProcess(
        "echo",
        "Echo",
        "Gives back its inputs under the same names: for trying a client and for the OGC test suite.",
        EchoInputs,
        EchoInputs,
        ("sync-execute", "async-execute", "dismiss"),
    ),
)
OFFERED_PROCESSES: Mapping[str, OfferedProcess] = {process.id: process for process in _OFFERED}


def offered_process(process_id: str) -> OfferedProcess:
    """Find a process by its id.

    Raises
    ------
    NoSuchProcessError
        There is none.
    """
    if process_id not in OFFERED_PROCESSES:
        raise NoSuchProcessError(process_id)
    return OFFERED_PROCESSES[process_id]


def input_descriptions(process: OfferedProcess) -> dict[str, InputDescription]:
    """Describe every input with its schema, in the dialect that OGC API - Processes 1.0 prescribes."""
    schema = _in_the_dialect_of_ogc(process.inputs.model_json_schema())
    required = schema.get("required", [])
    return {
        name: InputDescription(
            title=member.get("title", name),
            description=member.get("description", ""),
            min_occurs=int(name in required),
            json_schema=member,
        )
        for name, member in schema["properties"].items()
    }


def output_descriptions(process: OfferedProcess) -> dict[str, OutputDescription]:
    """Describe every output with its schema."""
    schema = _in_the_dialect_of_ogc(process.outputs.model_json_schema(mode="serialization"))
    return {
        name: OutputDescription(
            title=member.get("title", name), description=member.get("description", ""), json_schema=member
        )
        for name, member in schema["properties"].items()
    }


def _in_the_dialect_of_ogc(schema: dict[str, Any]) -> dict[str, Any]:
    return as_openapi_30(inlined(schema), KEPT | CONTENT)


def inlined(schema: dict[str, Any]) -> dict[str, Any]:
    """Replace every reference to `$defs` by what it refers to, so that each part of a schema stands alone."""
    definitions = schema.get("$defs", {})

    def expand(node: Any) -> Any:
        if isinstance(node, list):
            return [expand(each) for each in node]
        if not isinstance(node, dict):
            return node
        if "$ref" in node:
            name = node["$ref"].rpartition("/")[2]
            return {**expand(definitions[name]), **{key: expand(each) for key, each in node.items() if key != "$ref"}}
        # the mapping of a discriminator refers to definitions that are no longer there
        return {key: expand(each) for key, each in node.items() if key not in {"$defs", "discriminator"}}

    expanded: dict[str, Any] = expand(schema)
    return expanded
