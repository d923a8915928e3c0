"""Who changed what, and what was refused."""

from datetime import datetime

from pydantic import Field

from schemas.values.base import ResponseModel
from schemas.values.links import Link


class AuditDocument(ResponseModel):
    """One request that changed something or was refused."""

    time: datetime
    """When it came."""
    key: str
    """Public part of the key; empty: none, or none that is valid."""
    project: str
    """Project of the key; empty: none."""
    remote: str
    """Address that it came from."""
    method: str
    """HTTP method."""
    path: str
    """Path of the request."""
    status: int
    """Of the answer."""
    request_id: str
    """`X-Request-ID` of the answer, under which the log has more."""


class AuditList(ResponseModel):
    """One page of the audit log, newest first."""

    entries: list[AuditDocument]
    """The requests."""
    number_matched: int = Field(serialization_alias="numberMatched")
    """How many there are on all pages."""
    number_returned: int = Field(serialization_alias="numberReturned")
    """How many there are on this page."""
    links: list[Link]
    """Where to go from here."""
