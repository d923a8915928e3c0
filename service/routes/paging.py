"""Pages of lists."""

from typing import Annotated

from fastapi import Query

MAX_PAGE = 10_000
LimitParameter = Annotated[
    int, Query(ge=1, description=f"Most entries of the page; more than {MAX_PAGE} are never given.")
]
OffsetParameter = Annotated[int, Query(ge=0, le=2**31 - 1, description="Entries to skip.")]


def page_size(limit: int) -> int:
    """Bound the wish of a client."""
    return min(limit, MAX_PAGE)
