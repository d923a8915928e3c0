"""Addresses that answer browsers with a page, and leave all other requests to those that follow."""

from collections.abc import Mapping
from typing import Any, cast

from fastapi import Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from starlette.datastructures import Headers
from starlette.routing import Match, Route
from starlette.types import Scope as RequestScope

from service.dependencies import base_path_of
from service.names.messages.catalogue import LANGUAGES, Language, preferred_language
from service.ports import Scope
from service.routes.accepted_types import prefers_html
from service.routes.session_cookies import COOKIE
from service.use_cases.access.check_access import NOBODY, Access
from service.use_cases.access.manage_keys import shown_project
from service.web.page_rendering import POLICY, Reader, rendered

SEE_OTHER = 303
LANGUAGE = "lang"
"""Query parameter by which a reader has another language than the browser's."""


class PageRoute(Route):
    """Match requests of who would rather see a page than JSON."""

    def matches(self, scope: RequestScope) -> tuple[Match, RequestScope]:
        """Tell whether a request is for this page."""
        if scope["type"] != "http" or not prefers_html(Headers(scope=scope).get("accept", "")):
            return Match.NONE, {}
        match, child = super().matches(scope)
        return (match, child) if match is Match.FULL else (Match.NONE, {})


def page(
    request: Request,
    template: str,
    values: Mapping[str, Any] | None = None,
    *,
    status: int = 200,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Answer with a page, which is nobody else's and is not kept."""
    text = rendered(template, language_of(request), reader_of(request), request.scope["path"], values or {})
    own = {
        "Content-Security-Policy": POLICY,
        "Cache-Control": "private, no-store",
        "Vary": "Accept, Accept-Language, Cookie",
        "Content-Language": language_of(request),
        # without it browsers send `Origin: null` with forms, which says nothing of where they stand
        "Referrer-Policy": "same-origin",
    }
    return HTMLResponse(text, status, {**own, **(headers or {})})


def elsewhere(request: Request, path: str) -> Response:
    """Answer that a browser goes to another page of this service."""
    return RedirectResponse(base_path_of(request) + path, SEE_OTHER)


def language_of(request: Request) -> Language:
    """Give the language of the page that answers a request."""
    wanted = request.query_params.get(LANGUAGE, "")
    return next(
        (each for each in LANGUAGES if each == wanted), preferred_language(request.headers.get("accept-language"))
    )


def access_of(request: Request) -> Access:
    """Give who asks; nobody, where a request was refused before that was known."""
    return cast("Access", getattr(request.state, "access", NOBODY))


def reader_of(request: Request) -> Reader:
    """Give who reads the page that answers a request."""
    access = access_of(request)
    return Reader(
        project=None if access is NOBODY else shown_project(access.owner),
        has_session=bool(access.key_id) and COOKIE in request.cookies,
        may_write=Scope.WRITE in access.scopes,
        base=base_path_of(request),
    )
