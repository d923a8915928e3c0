"""Keys of clients."""

from datetime import datetime
from typing import Literal

from pydantic import AwareDatetime, Field

from schemas.values.base import RequestModel, ResponseModel
from schemas.values.links import Link

ScopeName = Literal["read", "write", "admin", "metrics"]


class KeyRequest(RequestModel):
    """A key that is to be made."""

    name: str
    """For people: 1 to 64 letters, digits, points, dashes, underscores; no valid key has it yet."""
    project: str | None = None
    """Whose files and jobs it sees; left out: one of the key's own name; `default`: what was made without keys."""
    scopes: list[ScopeName] = Field(default=["read", "write"])
    """What it is good for."""
    expires: AwareDatetime | None = None
    """When it ends by itself."""


class KeyDocument(ResponseModel):
    """A key, without its secret."""

    id: str
    """Public part of the key."""
    name: str
    """What people call it."""
    project: str
    """Whose files and jobs it sees."""
    scopes: list[ScopeName]
    """What it is good for."""
    created: datetime
    """When it was made."""
    expires: datetime | None
    """When it ends; null: never by itself."""
    revoked: datetime | None
    """When it was revoked; null: it was not."""
    last_used: datetime | None
    """To the minute."""
    links: list[Link]
    """Where to go from here."""


class NewKeyDocument(KeyDocument):
    """A new key with its secret."""

    key: str | None
    """What goes behind `Authorization: Bearer`. It is told once: null when the request is repeated."""


class KeyList(ResponseModel):
    """One page of keys, newest first."""

    keys: list[KeyDocument]
    """The keys."""
    number_matched: int = Field(serialization_alias="numberMatched")
    """How many there are on all pages."""
    number_returned: int = Field(serialization_alias="numberReturned")
    """How many there are on this page."""
    links: list[Link]
    """Where to go from here."""
