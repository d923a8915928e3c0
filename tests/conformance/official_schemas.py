"""What the schemas of OGC API - Processes 1.0 demand of documents (18-062r2; schemas.opengis.net, processes/part1/1.0).

The members, types and limits of those schemas, written down again; OpenAPI 3.0 has the JSON Schema of draft 4.
"""

import re
from datetime import datetime
from typing import Any
from urllib.parse import urlsplit

from jsonschema import Draft4Validator, FormatChecker

Schema = dict[str, Any]
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
NUMBER: Schema = {"type": "number"}
ANYTHING: Schema = {}
COUNT: Schema = {"type": "integer", "minimum": 0}


def described(**members: Schema) -> Schema:
    return {"title": TEXT, "description": TEXT, "keywords": listed(TEXT), **members}


def listed(items: Schema, **more: Any) -> Schema:
    return {"type": "array", "items": items, **more}


def one_of(*words: str) -> Schema:
    return {"type": "string", "enum": list(words)}


def document(properties: Schema, *required: str) -> Schema:
    return {"type": "object", "properties": properties, "required": list(required)}


def reference(name: str) -> Schema:
    return {"$ref": f"#/definitions/{name}"}


TIME: Schema = {"type": "string", "format": "date-time"}
LINK = document({"href": TEXT, "rel": TEXT, "type": TEXT, "hreflang": TEXT, "title": TEXT}, "href")
SCHEMA_OR_REFERENCE: Schema = {"oneOf": [reference("schema"), reference("reference")]}
SCHEMA_KEYWORDS: Schema = {
    **dict.fromkeys(("title", "description", "format", "pattern"), TEXT),
    **dict.fromkeys(("contentMediaType", "contentEncoding", "contentSchema"), TEXT),
    **dict.fromkeys(("maximum", "minimum"), NUMBER),
    "multipleOf": {"type": "number", "minimum": 0, "exclusiveMinimum": True},
    **dict.fromkeys(("exclusiveMaximum", "exclusiveMinimum", "uniqueItems", "nullable"), FLAG),
    **dict.fromkeys(("readOnly", "writeOnly", "deprecated"), FLAG),
    **dict.fromkeys(("maxLength", "minLength", "maxItems", "minItems", "maxProperties", "minProperties"), COUNT),
    "required": listed(TEXT, minItems=1, uniqueItems=True),
    "enum": {"type": "array", "minItems": 1},
    "type": one_of("array", "boolean", "integer", "number", "object", "string"),
    **dict.fromkeys(("not", "items"), SCHEMA_OR_REFERENCE),
    **dict.fromkeys(("allOf", "oneOf", "anyOf"), listed(SCHEMA_OR_REFERENCE)),
    "properties": {"type": "object", "additionalProperties": SCHEMA_OR_REFERENCE},
    "additionalProperties": {"oneOf": [reference("schema"), reference("reference"), {"type": "boolean"}]},
    **dict.fromkeys(("default", "example"), ANYTHING),
}
PROCESS_SUMMARY = document(
    described(
        id=TEXT,
        version=TEXT,
        jobControlOptions=listed(one_of("sync-execute", "async-execute", "dismiss")),
        outputTransmission=listed(one_of("value", "reference")),
        links=listed(reference("link")),
    ),
    "id",
    "version",
)
OCCURRENCES: Schema = {"oneOf": [{"type": "integer"}, one_of("unbounded")]}
STATUS_INFO = document(
    {
        **dict.fromkeys(("processID", "jobID", "message"), TEXT),
        "type": one_of("process"),
        "status": one_of("accepted", "running", "successful", "failed", "dismissed"),
        **dict.fromkeys(("created", "started", "finished", "updated"), TIME),
        "progress": {"type": "integer", "minimum": 0, "maximum": 100},
        "links": listed(reference("link")),
    },
    "jobID",
    "status",
    "type",
)
DEFINITIONS: dict[str, Schema] = {
    "link": LINK,
    "landingPage": document({"title": TEXT, "description": TEXT, "links": listed(reference("link"))}, "links"),
    "confClasses": document({"conformsTo": listed(TEXT)}, "conformsTo"),
    "exception": document({"type": TEXT, "title": TEXT, "status": {"type": "integer"}, "detail": TEXT}, "type"),
    "processSummary": PROCESS_SUMMARY,
    "processList": document(
        {"processes": listed(reference("processSummary")), "links": listed(reference("link"))}, "processes", "links"
    ),
    "reference": document({"$ref": {"type": "string", "format": "uri"}}, "$ref"),
    "schema": {
        "oneOf": [
            reference("reference"),
            {"type": "object", "properties": SCHEMA_KEYWORDS, "additionalProperties": False},
        ]
    },
    "inputDescription": document(
        described(minOccurs={"type": "integer"}, maxOccurs=OCCURRENCES, schema=reference("schema")), "schema"
    ),
    "outputDescription": document(described(schema=reference("schema")), "schema"),
    "process": {
        "allOf": [
            reference("processSummary"),
            document(
                {
                    "inputs": {"type": "object", "additionalProperties": reference("inputDescription")},
                    "outputs": {"type": "object", "additionalProperties": reference("outputDescription")},
                },
                "inputs",
                "outputs",
            ),
        ]
    },
    "statusInfo": STATUS_INFO,
    "jobList": document({"jobs": listed(reference("statusInfo")), "links": listed(reference("link"))}, "jobs", "links"),
}
FORMATS = FormatChecker(formats=())


@FormatChecker.checks(FORMATS, "date-time", raises=ValueError)
def _is_time(text: Any) -> bool:
    return bool(datetime.fromisoformat(text).tzinfo and re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", text))


def faults(name: str, found: Any) -> list[str]:
    """Say where a document is not as the named schema demands."""
    validator = Draft4Validator({**reference(name), "definitions": DEFINITIONS}, format_checker=FORMATS)
    return [
        f"{'/'.join(map(str, fault.absolute_path))}: {fault.message[:300]}" for fault in validator.iter_errors(found)
    ]


def assert_valid(name: str, found: Any) -> None:
    """Check a document against the named schema, and its links for being whole addresses."""
    assert faults(name, found) == []
    for link in found.get("links", []):
        assert urlsplit(link["href"]).netloc, link
