"""JSON documents."""

import json
from typing import Any

Json = dict[str, Any]


class JsonText(str):
    """A JSON document that another process has written, and that is kept as it is."""

    __slots__ = ()


def as_text(document: Json | JsonText) -> str:
    """Write a document, unless that is done already."""
    return document if isinstance(document, JsonText) else json.dumps(document)
