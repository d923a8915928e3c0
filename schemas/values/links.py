"""Links between resources (RFC 8288 in JSON)."""

from schemas.values.base import ResponseModel


class Link(ResponseModel):
    """One link."""

    href: str
    """Where it leads."""
    rel: str
    """What it leads to."""
    type: str = "application/json"
    """Media type of what is found there."""
    title: str = ""
    """What a person reads."""
