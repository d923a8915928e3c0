"""The cookie in which a browser keeps its session."""

from datetime import UTC, datetime
from typing import cast

from fastapi import Request, Response

from service.dependencies import base_path_of
from service.settings import Settings
from service.use_cases.access.browser_sessions import LASTS, BrowserSessions

COOKIE = "tieline-session"
PAGE_HEADER = "tieline-page"
"""Pages of this service send it with every change; pages of others cannot (they would have to ask first, in vain)."""


async def session_key(request: Request) -> str | None:
    """Give the key of the session that a browser sends along."""
    return await _sessions(request).key_of(request.cookies.get(COOKIE, ""), datetime.now(UTC))


async def begin_session(request: Request, answer: Response, key: str) -> None:
    """Let a browser keep a key, sealed: no script can read it, and no page of others sends it."""
    kept = await _sessions(request).begin(key, datetime.now(UTC))
    lasts_s = int(LASTS.total_seconds())
    answer.set_cookie(
        COOKIE, kept, lasts_s, httponly=True, samesite="strict", secure=_is_secure(request), path=_place(request)
    )


async def end_session(request: Request, answer: Response) -> None:
    """End the session that a browser sends along, also for whoever has a copy of it, and let the browser forget it."""
    await _sessions(request).end(request.cookies.get(COOKIE, ""))
    answer.delete_cookie(COOKIE, httponly=True, samesite="strict", secure=_is_secure(request), path=_place(request))


def _sessions(request: Request) -> BrowserSessions:
    return cast("BrowserSessions", request.app.state.sessions)


def _place(request: Request) -> str:
    return base_path_of(request) or "/"


def _is_secure(request: Request) -> bool:
    public = cast("Settings", request.app.state.settings).public_url or ""
    return request.url.scheme == "https" or public.startswith("https:")
