"""Several outputs in one answer, each in a part of its own (RFC 2387; OGC API - Processes 1.0, 7.11.4)."""

import json
import secrets
from collections.abc import Mapping
from typing import Any

from fastapi import Response
from fastapi.responses import JSONResponse, PlainTextResponse

OUTPUTS: Mapping[str, Any] = {
    "application/json": {"schema": {}},
    "text/plain": {"schema": {"type": "string"}},
    "multipart/related": {"schema": {"type": "string", "format": "binary"}},
}
"""How outputs may come, for the description of the interface."""
NO_OUTPUT = "None of the outputs that were wanted has a value."


def raw_outputs(outputs: Mapping[str, Any]) -> Response:
    """Give a single output bare, none as no content, several as parts named by their `Content-ID`."""
    if not outputs:
        return Response(status_code=204)
    if len(outputs) == 1:
        (value,) = outputs.values()
        return PlainTextResponse(value) if isinstance(value, str) else JSONResponse(value)
    boundary = secrets.token_hex(16)
    parts = b"".join(_part(name, value, boundary) for name, value in outputs.items())
    return Response(parts + f"--{boundary}--\r\n".encode(), media_type=f'multipart/related; boundary="{boundary}"')


def _part(name: str, value: Any, boundary: str) -> bytes:
    text = isinstance(value, str)
    kind = "text/plain; charset=utf-8" if text else "application/json"
    head = f"--{boundary}\r\nContent-Type: {kind}\r\nContent-ID: {name}\r\n\r\n"
    return head.encode() + (value if text else json.dumps(value)).encode() + b"\r\n"
