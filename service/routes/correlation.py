"""One name for a request wherever it leaves a trace: in the answer, in the log, in its job, in the audit."""

import re
from contextlib import AbstractContextManager

import structlog
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.names.identifiers import new_identifier

HEADER = "X-Request-ID"
GIVEN = re.compile(r"[A-Za-z0-9][A-Za-z0-9._:-]{0,127}")


def request_id_of(scope: Scope) -> str:
    """Give the name of a request."""
    return str(scope.get("state", {}).get("request_id", ""))


class RequestIds:
    """Name each request as its client does in `X-Request-ID`, or anew.

    Parameters
    ----------
    app
        Answers the requests.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get(HEADER, "")
        name = given if GIVEN.fullmatch(given) else new_identifier()
        scope.setdefault("state", {})["request_id"] = name

        async def send_named(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)[HEADER] = name  # in place of one that may be there
            await send(message)

        with _named(name):
            await self._app(scope, receive, send_named)


def _named(name: str) -> AbstractContextManager[None]:
    return structlog.contextvars.bound_contextvars(request_id=name)
