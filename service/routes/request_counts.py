"""Count requests for Prometheus: by route, method and status, with their sizes and times."""

import time
from collections.abc import Sequence
from functools import lru_cache

from prometheus_client import CollectorRegistry, Counter, Histogram, Summary
from starlette.routing import BaseRoute, Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

NOT_COUNTED = frozenset({"/healthz", "/readyz", "/metrics"})
"""What watches the service itself."""
NO_ROUTE = "none"
FINE_S = (0.01, 0.025, 0.05, 0.075, 0.1, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5, 7.5, 10, 30, 60)
COARSE_S = (0.1, 0.5, 1)
MOST_SERIES = 4096


class RequestFigures:
    """What is known of requests, under the names that dashboards for FastAPI look for.

    Parameters
    ----------
    registry
        Where Prometheus finds them.
    """

    def __init__(self, registry: CollectorRegistry) -> None:
        handler = ("handler",)
        self._number = Counter(
            "http_requests_total",
            "Total number of requests by method, status and handler.",
            ("method", "status", "handler"),
            registry=registry,
        )
        self._received = Summary(
            "http_request_size_bytes", "Content length of requests by handler.", handler, registry=registry
        )
        self._sent = Summary(
            "http_response_size_bytes", "Content length of answers by handler.", handler, registry=registry
        )
        self._fine = Histogram(
            "http_request_duration_highr_seconds", "Time to answer, all handlers.", buckets=FINE_S, registry=registry
        )
        self._coarse = Histogram(
            "http_request_duration_seconds",
            "Time to answer by handler.",
            ("method", "handler"),
            buckets=COARSE_S,
            registry=registry,
        )
        # looking series up by their labels takes longer than counting
        self._series = lru_cache(MOST_SERIES)(self._labelled)

    def count(self, handler: str, method: str, status: int, sizes: tuple[int, int], seconds: float) -> None:
        """Count one request, whose body and answer have these sizes."""
        number, received, sent, coarse = self._series(handler, method, status)
        number.inc()
        received.observe(sizes[0])
        sent.observe(sizes[1])
        self._fine.observe(seconds)
        coarse.observe(seconds)

    def _labelled(self, handler: str, method: str, status: int) -> tuple[Counter, Summary, Summary, Histogram]:
        return (
            self._number.labels(method, str(status), handler),
            self._received.labels(handler),
            self._sent.labels(handler),
            self._coarse.labels(method, handler),
        )


class RequestCounts:
    """Count requests, and how long they take until their answer begins.

    Parameters
    ----------
    app
        Answers the requests.
    figures
        Where they are counted.
    routes
        By whose paths.
    """

    def __init__(self, app: ASGIApp, figures: RequestFigures, routes: Sequence[BaseRoute]) -> None:
        self._app = app
        self._figures = figures
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        status, sent, seconds = 500, 0, None

        async def send_watched(message: Message) -> None:
            nonlocal status, sent, seconds
            if message["type"] == "http.response.start":
                status, sent = message["status"], _content_length(message)
                seconds = time.perf_counter() - began
            await send(message)

        try:
            await self._app(scope, receive, send_watched)
        finally:
            handler = self._handler(scope)
            if handler not in NOT_COUNTED:
                if seconds is None:
                    seconds = time.perf_counter() - began
                self._figures.count(handler, scope["method"], status, (_content_length(scope), sent), seconds)

    def _handler(self, scope: Scope) -> str:
        """Give the path of the route that has answered, or would have if the request had not been refused before."""
        path: str | None = getattr(scope.get("route"), "path", None)
        return path or self._would_have_answered(scope) or NO_ROUTE

    def _would_have_answered(self, scope: Scope) -> str | None:
        by_path: str | None = None
        for route in self._routes:
            match, _ = route.matches(scope)
            if match is Match.FULL:
                return getattr(route, "path", None)
            if match is Match.PARTIAL and by_path is None:
                by_path = getattr(route, "path", None)
        return by_path


def _content_length(holder: Message | Scope) -> int:
    for name, value in holder.get("headers", ()):
        if name == b"content-length":
            return int(value) if value.isdigit() else 0
    return 0
