"""Lists of a result that are too long for one document: how many entries they have, and where these are."""

from collections.abc import Callable
from typing import Any

from pydantic import ConfigDict, Field

from schemas.values.poses import Document


class ResultList(Document):
    """A list that does not stand in the document, which has no member there: its entries come page by page."""

    pointer: str = Field(description="JSON pointer (RFC 6901) of its place: put there, the document is whole.")
    count: int
    """Number of its entries."""
    href: str = Field(description="Its pages: `limit` and `offset` choose one, links lead to the others.")
    stream: str = Field(description="All of its entries, one a line (application/x-ndjson).")


class NetworkCounts(Document):
    """What the lists of a large network come to."""

    frame: str = Field(description="The station whose frame is the common one.")
    stations: dict[str, int]
    """Number of stations by their status."""
    pairs: dict[str, int]
    """Number of pairs that were tried by their status."""
    links: dict[str, int]
    """Number of registrations by what became of them in the network."""
    loops: int
    """Loops of registrations."""
    open_loops: int
    """Of these, those that do not close."""


def comes_in_pages(*members: str) -> ConfigDict:
    """Let the schema of a document say that of large networks some members are missing.

    Parameters
    ----------
    members
        Lists that then come page by page.
    """

    def not_required(schema: dict[str, Any]) -> None:
        schema["required"] = [name for name in schema.get("required", []) if name not in members]

    extra: Callable[[dict[str, Any]], None] = not_required
    return ConfigDict(json_schema_extra=extra)
