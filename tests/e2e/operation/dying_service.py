"""A service whose API process kills itself, once, at a chosen point of a request with an Idempotency-Key.

``python -m tests.e2e.operation.dying_service --data-dir …`` runs it; an empty file ``die-<point>`` in the data
directory arms it.
"""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.adapters.database.idempotency import DatabaseIdempotencyStore
from service.adapters.database.jobs import DatabaseJobStore
from service.launcher import serve
from service.main import app_from_environment
from service.settings import Settings
from service.use_cases.access import repeat_requests

POINTS: dict[str, tuple[type, str]] = {
    "read": (DatabaseIdempotencyStore, "note_fingerprint"),
    "made": (DatabaseJobStore, "create_and_enqueue"),
    "kept": (DatabaseIdempotencyStore, "keep_answer"),
}
ANSWERED = "answered"
HOLD_S, RENEW_S = 4.0, 1.0
"""Instead of a quarter of a minute: how long others wait for a request whose process died."""


def reach(point: str) -> None:
    """Die here, if it is to be."""
    armed = Settings().data_dir / f"die-{point}"
    if armed.exists():
        armed.unlink()
        os.kill(os.getpid(), signal.SIGKILL)


def dying_after(point: str, method: Callable[..., Any]) -> Callable[..., Any]:
    """Give a method after which the process may die."""

    def done(*arguments: Any, **named: Any) -> Any:
        outcome = method(*arguments, **named)
        reach(point)
        return outcome

    return done


class DyingWithTheAnswer:
    """Die when an answer has been handed to the network."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""

        async def sent(message: Message) -> None:
            await send(message)
            if message["type"] == "http.response.body" and scope["method"] == "POST":
                reach(ANSWERED)

        await self._app(scope, receive, sent if scope["type"] == "http" else send)


def app() -> ASGIApp:
    """Build the web application with its points of death."""
    repeat_requests.HOLD_S, repeat_requests.RENEW_S = HOLD_S, RENEW_S
    for point, (kind, name) in POINTS.items():
        setattr(kind, name, dying_after(point, getattr(kind, name)))
    return DyingWithTheAnswer(app_from_environment())


if __name__ == "__main__":
    directory = Path(sys.argv[sys.argv.index("--data-dir") + 1])
    serve(Settings(port=0, data_dir=directory), app="tests.e2e.operation.dying_service:app")
