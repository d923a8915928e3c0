"""The description of the interface once more in OpenAPI 3.0, which many clients of OGC services ask for."""

from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse

from service.routes.readable_router import ReadableRouter
from service.use_cases.inputs.schema_dialect import as_openapi_30

PATH = "/openapi-3.0.json"
MEDIA_TYPE = "application/vnd.oai.openapi+json;version=3.0"
VERSION = "3.0.3"

router = ReadableRouter()


@router.get(PATH, include_in_schema=False)
async def openapi_30(request: Request) -> JSONResponse:
    """Give the description in OpenAPI 3.0."""
    return JSONResponse(as_document_30(request.app.openapi()), media_type=MEDIA_TYPE)


def as_document_30(document: dict[str, Any]) -> dict[str, Any]:
    """Rewrite a description in OpenAPI 3.1: its schemas are what differs."""
    written = _with_schemas_30(document)
    components = dict(written.get("components", {}))
    components["schemas"] = {name: as_openapi_30(each) for name, each in components.get("schemas", {}).items()}
    return {**written, "openapi": VERSION, "components": components}


def _with_schemas_30(node: Any) -> Any:
    if isinstance(node, list):
        return [_with_schemas_30(each) for each in node]
    if not isinstance(node, dict):
        return node
    return {
        key: as_openapi_30(value) if key == "schema" else value if key == "schemas" else _with_schemas_30(value)
        for key, value in node.items()
    }
