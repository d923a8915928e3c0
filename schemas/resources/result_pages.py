"""Lists of a result, page by page."""

from typing import Any

from pydantic import Field

from schemas.values.base import ResponseModel
from schemas.values.links import Link


class ResultPage(ResponseModel):
    """One page of a list of a result."""

    entries: list[Any]
    """As they would stand in the result document, in their order."""
    number_matched: int = Field(serialization_alias="numberMatched")
    """Entries on all pages."""
    number_returned: int = Field(serialization_alias="numberReturned")
    """Entries on this page."""
    links: list[Link]
    """Where to go from here."""
