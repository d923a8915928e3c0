"""JSON Schema as OpenAPI 3.0 writes it, in which OGC API - Processes 1.0 describes inputs and outputs.

Pydantic writes JSON Schema 2020-12 (as OpenAPI 3.1 does). OpenAPI 3.0.3 (Schema Object) has one type per schema, null
as `nullable`, exclusive bounds as flags, and neither constants nor tuples.
"""

from collections.abc import Mapping, Sequence
from typing import Any

KEPT = frozenset(
    (
        *("title", "description", "type", "format", "default", "enum", "required", "pattern", "multipleOf"),
        *("minimum", "maximum", "minLength", "maxLength", "minItems", "maxItems", "uniqueItems"),
        *("minProperties", "maxProperties", "nullable", "deprecated", "readOnly", "writeOnly", "example", "$ref"),
    )
)
"""Keywords that both have, in which no schema is nested."""
CONTENT = frozenset(("contentMediaType", "contentEncoding", "contentSchema"))
"""Keywords that OGC API - Processes adds to those of OpenAPI 3.0."""
EXCLUSIVE = {"exclusiveMinimum": "minimum", "exclusiveMaximum": "maximum"}
ONE, SEVERAL, CHOICES = ("items", "not", "additionalProperties"), ("allOf",), ("anyOf", "oneOf")
"""Keywords in which schemas are nested."""
NULL = {"type": "null"}
Schema = dict[str, Any]


def as_openapi_30(schema: Any, kept: frozenset[str] = KEPT) -> Schema:
    """Rewrite a schema and all that are nested in it; keywords that are not in `kept` and not rewritten fall away."""
    if not isinstance(schema, Mapping):  # True: anything
        return {}
    if "$ref" in schema:
        return {"$ref": schema["$ref"]}  # what stands beside a reference is ignored in OpenAPI 3.0
    written = {key: value for key, value in schema.items() if key in kept} | _rewritten(schema)
    if "contentMediaType" in schema and "contentMediaType" not in kept:
        written["format"] = "binary"
    if not written.get("required", True):
        del written["required"]  # an empty list is not allowed
    written |= {key: as_openapi_30(schema[key], kept) for key in ONE if key in schema}
    written |= {key: [as_openapi_30(each, kept) for each in schema[key]] for key in SEVERAL if key in schema}
    if "properties" in schema:
        written["properties"] = {name: as_openapi_30(each, kept) for name, each in schema["properties"].items()}
    if isinstance(schema.get("additionalProperties"), bool):
        written["additionalProperties"] = schema["additionalProperties"]
    if "prefixItems" in schema:
        written["items"] = _joined([as_openapi_30(item, kept) for item in schema["prefixItems"]])
    for key in CHOICES:
        if key in schema:
            written = _choice(key, schema[key], kept) | written
    return written


def _rewritten(schema: Mapping[str, Any]) -> Schema:
    """Give what one keyword says by others."""
    written: Schema = {}
    for exclusive, bound in EXCLUSIVE.items():
        if exclusive in schema:
            written |= {bound: schema[exclusive], exclusive: True}
    if "const" in schema:
        written["enum"] = [schema["const"]]
    if "examples" in schema:
        written["example"] = schema["examples"][0]
    return written


def _choice(key: str, given: Sequence[Any], kept: frozenset[str]) -> Schema:
    """Write alternatives; null among them makes the others nullable."""
    alternatives = [as_openapi_30(each, kept) for each in given if each != NULL]
    if NULL in given:
        typed = next((number for number, each in enumerate(alternatives) if "type" in each), None)
        if typed is None:  # only beside a type does `nullable` mean anything
            alternatives.append({"type": "object", "nullable": True, "enum": [None]})
        else:
            alternatives[typed] = _or_null(alternatives[typed])
    if len(alternatives) == 1:
        return alternatives[0]
    return {"oneOf" if key == "oneOf" or _are_disjoint(alternatives) else "anyOf": alternatives}


def _or_null(schema: Schema) -> Schema:
    known = schema.get("enum")
    return {**schema, "nullable": True} if known is None else {**schema, "nullable": True, "enum": [*known, None]}


def _are_disjoint(alternatives: Sequence[Schema]) -> bool:
    """Tell whether no value can be of two of them."""
    types = ["number" if each.get("type") == "integer" else each.get("type") for each in alternatives]
    return None not in types and len(set(types)) == len(types)


def _joined(items: Sequence[Schema]) -> Schema:
    """Give the schema of the items of a tuple: one of those that its places have."""
    different = [item for number, item in enumerate(items) if item not in items[:number]]
    return different[0] if len(different) == 1 else {"anyOf": different}
