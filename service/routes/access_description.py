"""What the description of the interface says of keys."""

from typing import Any

from service.routes.access_rules import is_public, needs_keys_in_use

SCHEME = "key"
KEY = {
    "type": "http",
    "scheme": "bearer",
    "description": "A key as `tieline keys create` or `POST /keys` gives it. Keys are needed as soon as one exists, or "
    "when the operator requires them. `read` is needed to see, `write` to upload, start, dismiss and remove, `admin` "
    "for keys and the audit log, `metrics` or `admin` for the metrics; what a key sees is its project's.",
}


def describe_access(document: dict[str, Any]) -> None:
    """Add to a description in OpenAPI which requests need a key: `{}` beside it says that there may be no keys."""
    document["components"]["securitySchemes"] = {SCHEME: KEY}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            if is_public(method.upper(), path):
                operation["security"] = []
            elif needs_keys_in_use(path):
                operation["security"] = [{SCHEME: []}]
            else:
                operation["security"] = [{SCHEME: []}, {}]
