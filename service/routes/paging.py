"""Pages of lists."""

from typing import Annotated, Any

from fastapi import Query
from pydantic import BeforeValidator, Field

MAX_PAGE = 10_000


def _whole(text: Any) -> Any:
    """Refuse `1.0`, which would pass for 1 although the description says that whole numbers are expected."""
    if isinstance(text, str) and not (text.isascii() and text.removeprefix("-").isdecimal()):
        raise ValueError("write a whole number in digits")
    return text


WHOLE = BeforeValidator(_whole)
"""Stands behind the bounds, so that the description keeps them."""
LimitParameter = Annotated[
    int, Field(ge=1), WHOLE, Query(description=f"Most entries of the page; more than {MAX_PAGE} are never given.")
]
OffsetParameter = Annotated[int, Field(ge=0, le=2**31 - 1), WHOLE, Query(description="Entries to skip.")]


def page_size(limit: int) -> int:
    """Bound the wish of a client."""
    return min(limit, MAX_PAGE)
