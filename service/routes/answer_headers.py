"""What every answer says to browsers: what it is, that no page may frame or load it, and that it is nobody else's."""

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.routes.access_rules import is_public

NOTHING = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""A document that is data loads nothing, wherever it is opened."""
PAGE = f"{NOTHING}; style-src 'unsafe-inline'; img-src data:"
"""Pages and reports have their style and drawings in themselves, no scripts, and nothing of other hosts."""
ALWAYS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
}
OWN = "private, no-store"
"""For what belongs to a project."""


class AnswerHeaders:
    """Say it, unless the answer says otherwise.

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

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                public = is_public(scope["method"], scope["path"])
                add_headers(MutableHeaders(scope=message), public=public)
            await send(message)

        await self._app(scope, receive, send_guarded)


def add_headers(headers: MutableHeaders, *, public: bool = False) -> None:
    """Add what an answer does not say by itself; `public`: it is the same for everybody."""
    for name, value in ALWAYS.items():
        headers.setdefault(name, value)
    kind = headers.get("content-type", "")
    if kind.startswith(("text/html", "application/json", "application/problem+json")):
        headers.add_vary_header("Accept")  # many addresses have a page for people and a document for programs
    page = kind.startswith(("text/html", "image/svg"))
    headers.setdefault("Content-Security-Policy", PAGE if page else NOTHING)
    if not public:
        headers.setdefault("Cache-Control", OWN)
