"""What the description of the interface says of processes: a named schema for each request, result and part of them."""

from collections.abc import Iterator, Sequence
from typing import Any

from pydantic.json_schema import JsonSchemaMode, models_json_schema

from service.ports import Process

COMPONENTS = "#/components/schemas/"
EXECUTE, RESULTS, SOME_OUTPUTS = "Execute", "Results", "SomeOutputs"
REFERENCE_TO_RESULTS = {"$ref": COMPONENTS + RESULTS}
Schema = dict[str, Any]


def process_components(processes: Sequence[Process[Any]]) -> dict[str, Schema]:
    """Give the schemas of all requests for an execution, of all results, and of their parts, each once, by name.

    Where a part of requests and one of results have the same name, that of results is called ``…Result``.
    """
    requests: list[tuple[Any, JsonSchemaMode]] = [(process.request_model, "validation") for process in processes]
    results: list[tuple[Any, JsonSchemaMode]] = [(process.outputs, "serialization") for process in processes]
    found, definitions = models_json_schema([*requests, *results], ref_template=COMPONENTS + "{model}")
    names = {name: _short(name) for name in definitions["$defs"]}
    components = {names[name]: _renamed(schema, names) for name, schema in definitions["$defs"].items()}
    for name, component in components.items():
        component["title"] = name  # by which generators call what they make of it
    components[SOME_OUTPUTS] = {
        "title": SOME_OUTPUTS,
        "description": "The outputs that were wanted by name; where one was wanted `raw`, its value.",
    }
    components[EXECUTE] = {
        "title": EXECUTE,
        "description": "Inputs of a process and how its outputs are wanted: of which process, the address says.",
        "anyOf": [_renamed(found[each], names) for each in requests],
    }
    components[RESULTS] = {
        "title": RESULTS,
        "description": "Result document of a job: of which process, the status of the job says.",
        "anyOf": [*(_renamed(found[each], names) for each in results), {"$ref": COMPONENTS + SOME_OUTPUTS}],
    }
    return components


def conflicting(first: dict[str, Schema], second: dict[str, Schema]) -> Iterator[str]:
    """Name what is called the same and is not."""
    return (name for name in first.keys() & second.keys() if first[name] != second[name])


def _short(name: str) -> str:
    """Give the name of a component: pydantic tells parts of requests and of results apart only where it must."""
    stem, _, mode = name.partition("-")
    return stem + "Result" if mode == "Output" else stem


def _renamed(node: Any, names: dict[str, str]) -> Any:
    if isinstance(node, list):
        return [_renamed(each, names) for each in node]
    if isinstance(node, str) and node.startswith(COMPONENTS):
        return COMPONENTS + names[node.removeprefix(COMPONENTS)]
    if isinstance(node, dict):
        return {key: _renamed(each, names) for key, each in node.items()}
    return node
