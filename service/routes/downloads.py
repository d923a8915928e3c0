"""Stored bytes as answers: ranges and conditions (RFC 9110, 13 and 14), the same from every machine of the service."""

import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from email.utils import format_datetime
from pathlib import Path
from typing import Any

from fastapi import Request, Response
from fastapi.responses import FileResponse
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import Receive, Scope, Send

from service.errors import RangeNotSatisfiableError, to_problem
from service.routes.problems import problem_response

RANGE = re.compile(r"\s*(\d{0,18})\s*-\s*(\d{0,18})\s*")
MOST_RANGES = 100
BINARY = {"schema": {"type": "string", "format": "binary"}}
ANY: Mapping[str, Any] = {"application/octet-stream": BINARY, "*/*": BINARY}
"""The first for generators of clients, which take `*/*` for nothing."""
DOWNLOAD_RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {"description": "The whole of it.", "content": ANY},
    206: {"description": "The range that was asked for.", "content": ANY},
    304: {"description": "It is what the client has already (`If-None-Match`)."},
}


class Download(FileResponse):
    """Send a local file, or ranges of it.

    Parameters
    ----------
    path
        The file.
    identity
        Names the bytes: what is equal has the same, whichever machine sends it.
    modified
        When the bytes came to be.
    media_type, filename, inline
        What it is, how a client may call it (None: no name), and whether a browser may show it.
    """

    def __init__(
        self,
        path: Path,
        *,
        identity: str,
        modified: datetime,
        media_type: str,
        filename: str | None = None,
        inline: bool = False,
    ) -> None:
        headers = {
            "ETag": f'"{identity}"',
            "Last-Modified": format_datetime(modified.replace(microsecond=0), usegmt=True),
            "X-Content-Type-Options": "nosniff",
        }
        kind = "inline" if inline else "attachment"
        stored = path.stat()
        self._size = stored.st_size
        super().__init__(
            path,
            media_type=media_type,
            filename=filename,
            content_disposition_type=kind,
            headers=headers,
            stat_result=stored,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        asked = Headers(scope=scope)
        if self._is_known(asked.get("if-none-match", "")):
            kept = {name: self.headers[name] for name in ("etag", "last-modified")}
            await Response(status_code=304, headers=kept)(scope, receive, send)
            return
        ranges = None
        if scope["method"] == "GET" and self._unchanged(asked.get("if-range")):
            ranges = satisfiable_ranges(asked.get("range", ""), self._size)
        if ranges == []:
            await self._refusal(scope)(scope, receive, send)
            return
        headers = MutableHeaders(raw=[pair for pair in scope["headers"] if pair[0] not in {b"range", b"if-range"}])
        if ranges:
            headers["range"] = "bytes=" + ",".join(f"{first}-{last}" for first, last in ranges)
        await super().__call__({**scope, "headers": headers.raw}, receive, send)

    def _is_known(self, asked: str) -> bool:
        tags = [tag.strip().removeprefix("W/") for tag in asked.split(",")]
        return asked.strip() == "*" or self.headers["etag"] in tags

    def _unchanged(self, condition: str | None) -> bool:
        return condition is None or condition in {self.headers["etag"], self.headers["last-modified"]}

    def _refusal(self, scope: Scope) -> Response:
        problem = to_problem(RangeNotSatisfiableError(self._size))
        return problem_response(problem, Request(scope), {"Content-Range": f"bytes */{self._size}"})


def satisfiable_ranges(asked: str, size: int) -> Sequence[tuple[int, int]] | None:
    """Give first and last byte of each range that can be served.

    Returns
    -------
    None when there is no header, or one that is to be ignored: of another unit, malformed, or of too many ranges; an
    empty list when none of its ranges can be served.
    """
    unit, _, text = asked.partition("=")
    pieces = [RANGE.fullmatch(piece) for piece in text.split(",") if piece.strip()]
    if unit.strip().lower() != "bytes" or not 0 < len(pieces) <= MOST_RANGES:
        return None
    found = []
    for piece in pieces:
        if piece is None or not (piece[1] or piece[2]) or (piece[1] and piece[2] and int(piece[1]) > int(piece[2])):
            return None
        first = int(piece[1]) if piece[1] else max(0, size - int(piece[2]))
        last = min(int(piece[2]), size - 1) if piece[1] and piece[2] else size - 1
        if first <= last:
            found.append((first, last))
    return found
