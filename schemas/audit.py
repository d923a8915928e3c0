"""Who changed what, and what was refused."""

from datetime import datetime

from pydantic import Field

from schemas.base import ResponseModel
from schemas.links import Link


class AuditDocument(ResponseModel):
    """One request that changed something or was refused."""

    time: datetime
    key: str
    """Public part of the key; empty: none, or none that is valid."""
    project: str
    remote: str
    """Address that it came from."""
    method: str
    path: str
    status: int
    """Of the answer."""
    request_id: str
    """`X-Request-ID` of the answer, under which the log has more."""


class AuditList(ResponseModel):
    """One page of the audit log, newest first."""

    entries: list[AuditDocument]
    number_matched: int = Field(serialization_alias="numberMatched")
    number_returned: int = Field(serialization_alias="numberReturned")
    links: list[Link]
