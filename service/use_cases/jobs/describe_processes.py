"""Descriptions of processes from the models of their inputs and outputs."""

from typing import Any

from schemas.resources.processes import InputDescription, OutputDescription
from service.ports import Process
from service.use_cases.inputs.schema_dialect import CONTENT, KEPT, as_openapi_30


def input_descriptions(process: Process[Any]) -> dict[str, InputDescription]:
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


def output_descriptions(process: Process[Any]) -> dict[str, OutputDescription]:
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
