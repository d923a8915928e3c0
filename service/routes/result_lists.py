"""Lists of a result, page by page or as a stream: those of large networks stand in no document."""

from collections.abc import Iterator
from typing import Any

from fastapi import Request, Response
from fastapi.responses import StreamingResponse

from schemas.resources.result_pages import ResultPage
from service.dependencies import AdaptersDependency, BaseUrlDependency
from service.names.result_lists import MEDIA_TYPE, STREAMED, list_address
from service.routes.accepted_types import accepts_only
from service.routes.documents import page_links
from service.routes.paging import LimitParameter, OffsetParameter, page_size
from service.routes.problems import PROBLEM_RESPONSES, problem_response
from service.routes.readable_router import ReadableRouter
from service.use_cases.jobs.find_rows import Rows, find_list

router = ReadableRouter(tags=["jobs"], responses=PROBLEM_RESPONSES)
BLOCK_BYTES = 1 << 16
"""Rows are sent together up to about so many."""
PAGE_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A page of the list; or all of it, one entry a line.",
        "content": {
            "application/json": {"schema": {"$ref": "#/components/schemas/ResultPage"}},
            MEDIA_TYPE: {"schema": {"type": "string"}},
        },
    }
}


@router.get(
    "/jobs/{job_id}/results/{list_name}",
    summary="A list of a result",
    response_model=ResultPage,
    responses=PAGE_RESPONSES,
)
def get_result_list(
    job_id: str,
    list_name: str,
    request: Request,
    adapters: AdaptersDependency,
    url: BaseUrlDependency,
    limit: LimitParameter = 100,
    offset: OffsetParameter = 0,
) -> Response:
    """Give a page of `stations`, `pairs`, `features`, `links`, `loops` or another list of a registration.

    With `.ndjson` behind the name, or where only `application/x-ndjson` is accepted, all of it comes as a stream, one
    entry a line. The lists of a large network stand in no document: its result tells names and lengths in `lists`.
    """
    streamed = list_name.endswith(STREAMED) or accepts_only(request.headers.get("accept", ""), MEDIA_TYPE)
    name = list_name.removesuffix(STREAMED)
    found = find_list(job_id, name, adapters.jobs, adapters.blobs)
    if isinstance(found, dict):
        return problem_response(found, request)
    if request.method == "HEAD":  # nothing is read for it
        return Response(media_type=MEDIA_TYPE if streamed else "application/json")
    if streamed:
        return _streamed((row + b"\n" for row in found.rows(0, found.count)), MEDIA_TYPE)
    size = page_size(limit)
    links = page_links(url, list_address(job_id, name), {}, size, offset, found.count)
    page = ResultPage(
        entries=[],
        number_matched=found.count,
        number_returned=max(0, min(size, found.count - offset)),
        links=links,
    )
    return _streamed(_as_page(page, found, offset, size), "application/json")


def _as_page(page: ResultPage, found: Rows, offset: int, size: int) -> Iterator[bytes]:
    """Put rows in the place of the entries of a page, which has none, without parsing them."""
    before, after = page.model_dump_json(by_alias=True).encode().split(b"[]", 1)
    yield before + b"["
    for number, row in enumerate(found.rows(offset, offset + size)):
        yield row if number == 0 else b"," + row
    yield b"]" + after


def _streamed(pieces: Iterator[bytes], media_type: str) -> Response:
    return StreamingResponse(_blocks(pieces), media_type=media_type, headers={"X-Content-Type-Options": "nosniff"})


def _blocks(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Join small pieces: each one that is sent goes from thread to thread."""
    block = bytearray()
    for piece in pieces:
        block += piece
        if len(block) >= BLOCK_BYTES:
            yield bytes(block)
            block.clear()
    yield bytes(block)
