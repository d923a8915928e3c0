"""What every request passes before anything of its body is read: who asks, what they may do, how often."""

import asyncio
import time
from dataclasses import dataclass
from datetime import UTC, datetime

import structlog
from fastapi import Request
from sqlalchemy.exc import SQLAlchemyError
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import ServiceError
from service.ports import AuditEntry, AuditLog
from service.refusals import ForbiddenError, ForeignPageError, KeysNotInUseError, UnauthenticatedError
from service.routes.accepted_types import prefers_html
from service.routes.access_rules import SAFE, SESSIONS, is_public, needs_keys_in_use, scopes_for
from service.routes.correlation import request_id_of
from service.routes.problems import away, error_response
from service.routes.session_cookies import PAGE_HEADER, session_key
from service.routes.trusted_requests import TrustedRequests
from service.settings import Settings
from service.use_cases.access.check_access import LOOK_AGAIN_S, NOBODY, WITHOUT_KEY, Access, Gatekeeper
from service.use_cases.limits.limit_rates import Rate, network_of
from service.use_cases.uploads.forget_old import REFUSALS

MOST_REFUSALS_KEPT = 60
"""In a minute, for each address and key: the log has all, the audit log is not filled by who hammers at the door."""
LONGEST_PATH = 1000
ALIVE = "/healthz"
"""Whoever asks whether the process lives is told so at once."""
log = structlog.get_logger()


@dataclass(frozen=True)
class Doorway:
    """What the gate works with."""

    gatekeeper: Gatekeeper
    audit: AuditLog
    settings: Settings


class Gate:
    """Let requests in, and note those that change something and those that were refused.

    Routes find who asks in ``request.state.access``; without it no store can be had, so nothing is open by mistake.

    Parameters
    ----------
    app
        Answers the requests.
    doorway
        Who knows keys, where is noted what happens.
    """

    def __init__(self, app: ASGIApp, doorway: Doorway) -> None:
        self._app = app
        self._gatekeeper = doorway.gatekeeper
        self._audit = doorway.audit
        self._trusted = TrustedRequests(doorway.settings)
        self._rate = Rate("requests with this key", doorway.settings.max_requests_per_minute)
        self._address_rate = Rate(
            "requests from this address without a key", doorway.settings.max_address_requests_per_minute
        )
        self._kept_refusals = Rate("refusals that are kept", MOST_REFUSALS_KEPT)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        visit = _Visit(Request(scope))
        try:
            visit.access = await self._admitted(visit)
        except (ServiceError, SQLAlchemyError) as error:
            known = error if isinstance(error, ServiceError) else away(error, visit.path)
            answer = error_response(known, visit.request)
            await self._note(visit, answer.status_code)
            await answer(scope, receive, send)
            return
        scope["state"]["access"] = visit.access
        watch = _Watch(self._gatekeeper, visit)

        async def noted(message: Message) -> None:
            if message["type"] == "http.response.start":
                visit.answered = True
                await self._note(visit, message["status"])
            await watch.send(message, send)

        try:
            await self._app(scope, watch.guarded(receive), noted)
        except BaseException as error:
            if watch.ended and isinstance(error, OSError | RuntimeError):
                return  # the framework's word for the end that was made here
            if not visit.answered:
                await self._note(visit, 500)
            raise

    async def _admitted(self, visit: "_Visit") -> Access:
        method, path = visit.request.method, visit.path
        if path == ALIVE and method in SAFE:
            return NOBODY
        public = is_public(method, path)
        if not await self._needs_keys(public=public):
            self._trusted.require(visit.request.scope)
        elif public:
            self._address_rate.require(network_of(visit.remote))
        if path in SESSIONS and method not in SAFE and not self._trusted.is_of_own_page(visit.request.scope):
            raise ForeignPageError
        if public:
            return await self._reader_of_page(visit) if visit.wants_page else NOBODY
        access = await self._gatekeeper.access(await self._authorization(visit), visit.remote)
        visit.access = access
        if access is WITHOUT_KEY:
            if needs_keys_in_use(path):
                raise KeysNotInUseError
            return access
        self._rate.require(access.key_id)
        wanted = scopes_for(method, path)
        if access.scopes.isdisjoint(wanted):
            raise ForbiddenError(wanted[0].value)
        return access

    async def _authorization(self, visit: "_Visit") -> str | None:
        """Give the key that a request brings itself, or that of the session which a browser sends along.

        Raises
        ------
        ForeignPageError
            A browser sends its session along with a change that no page of this service has asked for.
        """
        brought = visit.request.headers.get("authorization")
        key = await session_key(visit.request) if brought is None else None
        if key is None:
            return brought
        scope = visit.request.scope
        own = PAGE_HEADER in visit.request.headers and self._trusted.is_of_own_page(scope)
        if visit.request.method not in SAFE and not own:
            raise ForeignPageError
        return f"Bearer {key}"

    async def _reader_of_page(self, visit: "_Visit") -> Access:
        """Tell who reads a page that everybody may read."""
        try:
            return await self._gatekeeper.access(await self._authorization(visit), visit.remote)
        except UnauthenticatedError:
            return NOBODY

    async def _needs_keys(self, *, public: bool) -> bool:
        """Tell whether nobody may come in without a key; what describes the service is told without its database."""
        try:
            return await self._gatekeeper.needs_keys()
        except SQLAlchemyError:
            if public:
                return self._gatekeeper.needed_keys
            raise

    async def _note(self, visit: "_Visit", status: int) -> None:
        """Note a change or a refusal before it is answered."""
        if visit.request.method in SAFE and status not in REFUSALS:
            return
        entry = AuditEntry(
            time=datetime.now(UTC),
            key_id=visit.access.key_id,
            project=visit.access.owner,
            remote=visit.remote[:64],
            method=visit.request.method[:16],
            path=visit.path[:LONGEST_PATH].replace("\0", "\N{REPLACEMENT CHARACTER}"),  # no database takes it
            status=status,
            request_id=request_id_of(visit.request.scope),
        )
        log.info(
            "refused" if status in REFUSALS else "request",
            method=entry.method,
            path=entry.path,
            status=status,
            key=entry.key_id,
            project=entry.project,
            remote=entry.remote,
            seconds=round(time.monotonic() - visit.began, 3),
        )
        if status in REFUSALS and not self._kept_refusals.allows(f"{entry.remote} {entry.key_id}"):
            return
        try:
            await asyncio.to_thread(self._audit.write, entry)
        except SQLAlchemyError as error:
            log.exception("the audit log cannot be written", error=str(error))


class _Visit:
    """One request on its way."""

    def __init__(self, request: Request) -> None:
        self.request = request
        # not that of `request.url`, which strangers can change by their header Host
        self.path: str = request.scope["path"]
        self.access = NOBODY
        self.remote = request.client.host if request.client else ""
        self.wants_page = request.method in SAFE and prefers_html(request.headers.get("accept", ""))
        self.began = time.monotonic()
        self.answered = False


class _Watch:
    """End what lasts long when its key is revoked meanwhile: bodies that come in, events that go out."""

    def __init__(self, gatekeeper: Gatekeeper, visit: _Visit) -> None:
        self._gatekeeper = gatekeeper
        self._access = visit.access
        self._changes = visit.request.method not in SAFE
        self._looked = time.monotonic()
        self._events = False
        self.ended = False

    def guarded(self, receive: Receive) -> Receive:
        if not self._access.proof or not self._changes:
            return receive

        async def receive_guarded() -> Message:
            if not await self._still_valid():
                raise UnauthenticatedError(given=True)
            return await receive()

        return receive_guarded

    async def send(self, message: Message, send: Send) -> None:
        if message["type"] == "http.response.start":
            headers = dict(message.get("headers", ()))
            self._events = headers.get(b"content-type", b"").startswith(b"text/event-stream")
        elif self._events and message.get("more_body") and not await self._still_valid():
            self.ended = True
            await send({"type": "http.response.body", "body": b"", "more_body": False})
            raise OSError("the key was revoked")
        await send(message)

    async def _still_valid(self) -> bool:
        now = time.monotonic()
        if not self._access.proof or now - self._looked < LOOK_AGAIN_S:
            return True
        self._looked = now
        return await self._gatekeeper.still_valid(self._access)
