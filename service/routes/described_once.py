"""What describes the service is put together once, however often and by whomever it is asked for."""

import hashlib
from collections import OrderedDict
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.routes.accepted_types import prefers_html
from service.routes.access_rules import PUBLIC
from service.use_cases.access.service_proof import CHALLENGE_HEADER

CHANGING = frozenset({"/healthz", "/login", "/readyz"})
BELOW = "/processes/"
MOST_BYTES = 16_000_000
"""Of all answers that are kept: each has the links of the name by which it was asked for."""
LONGEST_KEY = 2000


@dataclass(frozen=True)
class _Kept:
    start: Message
    body: bytes


class DescribedOnce:
    """Keep the answers that describe the service, and name each by its content.

    Parameters
    ----------
    app
        Answers the requests.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._kept: OrderedDict[tuple[str, ...], _Kept] = OrderedDict()
        self._bytes = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or not _describes(scope):
            await self._app(scope, receive, send)
            return
        asked = Headers(scope=scope)
        key = (scope["path"], scope["scheme"], *(asked.get(name, "") for name in ("host", "accept")))
        key += (scope["query_string"].decode("latin-1"),)
        kept = self._kept.get(key)
        if kept is None:
            kept = await self._answered(scope, receive)
            if kept.start["status"] == 200 and sum(map(len, key)) < LONGEST_KEY:
                self._keep(key, kept)
        else:
            self._kept.move_to_end(key)
        await _send(kept, asked.get("if-none-match", ""), send, head=scope["method"] == "HEAD")

    async def _answered(self, scope: Scope, receive: Receive) -> _Kept:
        messages: list[Message] = []

        async def collect(message: Message) -> None:
            messages.append(message)

        await self._app({**scope, "method": "GET"}, receive, collect)
        body = b"".join(message.get("body", b"") for message in messages[1:])
        start = messages[0]
        if start["status"] == 200:
            headers = MutableHeaders(scope=start)
            headers["ETag"] = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
            headers["Cache-Control"] = "no-cache"
        return _Kept(start, body)

    def _keep(self, key: tuple[str, ...], kept: _Kept) -> None:
        self._kept[key] = kept
        self._bytes += len(kept.body)
        while self._bytes > MOST_BYTES:
            _, oldest = self._kept.popitem(last=False)
            self._bytes -= len(oldest.body)


def _describes(scope: Scope) -> bool:
    path, headers = scope["path"], Headers(scope=scope)
    fixed = (path in PUBLIC and path not in CHANGING) or path.startswith(BELOW)
    # a page says to whom it is shown
    asked_alike = CHALLENGE_HEADER not in headers and not prefers_html(headers.get("accept", ""))
    return fixed and scope["method"] in {"GET", "HEAD"} and asked_alike


async def _send(kept: _Kept, known: str, send: Send, *, head: bool) -> None:
    headers = MutableHeaders(raw=list(kept.start["headers"]))
    tags = {tag.strip().removeprefix("W/") for tag in known.split(",")}
    if kept.start["status"] == 200 and (headers.get("etag") in tags or known.strip() == "*"):
        for name in ("content-length", "content-type"):
            del headers[name]
        await send({**kept.start, "status": 304, "headers": headers.raw})
        await send({"type": "http.response.body", "body": b""})
        return
    await send({**kept.start, "headers": headers.raw})  # a copy: others add to it what is of one request only
    await send({"type": "http.response.body", "body": b"" if head else kept.body})
