"""The execution requests that the OGC test suite makes from the description of an echo process.

`ets-ogcapi-processes10` looks at `type`, or at the types in `oneOf`, of each input's schema, and sends what follows.
"""

from collections.abc import Mapping
from typing import Any

Document = dict[str, Any]
TEXT = "teststring"
BOX = {"crs": "urn:ogc:def:crs:EPSG:6.6:4326", "bbox": [345345345] * 4}
ARRAYS: Mapping[str, list[Any]] = {
    "integer": [1, 2, 3],
    "double": [1.1, 2.2, 3.3],
    "float": [1.1, 2.2, 3.3],
    "string": ["test1", "test2", "test3"],
}


def types_of(schema: Document) -> list[Document]:
    """Give the schemas whose types the suite sees; those of `anyOf` and `allOf` it passes over."""
    return [schema] if "type" in schema else [each for each in schema.get("oneOf", []) if "type" in each]


def is_box(schema: Document) -> bool:
    return any("bbox" in each.get("properties", {}) for each in types_of(schema))


def usual_value(schema: Document) -> Any:
    """Give what the suite sends for an input; None: nothing."""
    value = None
    for each in types_of(schema):
        if each["type"] == "string":
            formatted = schema.get("format") if each is schema else None
            value = value if formatted or "contentMediaType" in each else TEXT
        elif is_box(schema):
            value = BOX
        elif each["type"] == "object":
            value = {"value": TEXT}
    return value


def usual_inputs(description: Document) -> Document:
    values = {name: usual_value(each["schema"]) for name, each in description["inputs"].items()}
    return {name: value for name, value in values.items() if value is not None}


def array_input(description: Document) -> Document:
    """Give the first input that takes arrays, with one."""
    for name, each in description["inputs"].items():
        arrays = [found for found in types_of(each["schema"]) if found["type"] == "array"]
        if arrays:
            # the suite takes the first type that is not an array, of items or of the other alternatives
            kinds = [found["items"]["type"] for found in arrays if "type" in found.get("items", {})]
            kinds += [found["type"] for found in types_of(each["schema"]) if found["type"] != "array"]
            return {name: ARRAYS.get(kinds[0], [])}
    raise AssertionError("no input takes arrays")


def formatted_inputs(description: Document) -> list[str]:
    """Name the inputs that have a media type: the suite sends them in a wrong one."""
    return [
        name
        for name, each in description["inputs"].items()
        if any("contentMediaType" in found for found in types_of(each["schema"]))
    ]


def request(description: Document, inputs: Document, *outputs: str, **more: Any) -> Document:
    """Give a whole execution request for the outputs, or for all."""
    wanted = {name: {"transmissionMode": "value"} for name in outputs or description["outputs"]}
    return {"inputs": inputs, "outputs": wanted, **more}
