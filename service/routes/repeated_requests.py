"""`Idempotency-Key` on every request that makes something: the first answer is given again.

A column with the key in the table of jobs would do for jobs alone, and they have as much: the job's identifier follows
from a seed that is kept with the key, and its row is written in the transaction that puts it on the queue, so a repeat
cannot make a second one. What is kept beside it is what that row cannot tell: that another request comes with the same
key, that the first one is still under way, and the answers about files, uploads and new keys.
"""

import asyncio
import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from email.message import Message as HeaderMessage
from typing import cast

from fastapi import Request, Response
from sqlalchemy.exc import SQLAlchemyError
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.dependencies import belongings_of
from service.errors import FieldFault, InvalidRequestError, ServiceError
from service.names.identifiers import identifiers_from, new_identifier
from service.ports import Answer, Claim, IdempotencyStore
from service.routes.problems import away, error_response
from service.routes.request_bodies import body_of, media_type
from service.settings import Settings
from service.use_cases.access.repeat_requests import Fingerprint, Repeatable
from service.use_cases.inputs.validate_request import pointer_to

HEADER = "idempotency-key"
KEY = re.compile(r"[\x21-\x7e]([\x20-\x7e]{0,253}[\x21-\x7e])?")
REPLAYED = "Idempotent-Replayed"
LARGEST_ANSWER = 1_000_000
"""Answers that say what was made are small; only `echo`, which makes nothing, may say more."""
TELLING = ("content-disposition", "upload-length", "upload-metadata", "prefer", "priority")
"""Headers that say what a request wants."""


class RepeatedRequests:
    """Do requests with an Idempotency-Key once.

    Parameters
    ----------
    app
        Answers the requests.
    answers
        Where first answers are kept.
    """

    def __init__(self, app: ASGIApp, answers: IdempotencyStore) -> None:
        self._app = app
        self._answers = answers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http" or not _makes_something(request := Request(scope, receive)):
            await self._app(scope, receive, send)
            return
        try:
            this = Repeatable(self._answers, request.state.access.owner, _key(request), new_identifier())
            settings = cast("Settings", request.app.state.settings)
            await asyncio.to_thread(belongings_of(request).require_record, settings, 0)
            claim = await this.claim(datetime.now(UTC))
            attempt = _Attempt(this, claim, request, receive, send)
            answer = await (attempt.begin() if claim.answer is None else _again(request, this, claim))
        except (ServiceError, SQLAlchemyError) as error:
            answer = error_response(_known(error, request), request)
        if answer is not None:
            await answer(scope, receive, send)
            return
        scope["state"]["identifiers"] = identifiers_from(claim.seed)
        async with this.held():
            await attempt.run(self._app)


class _Attempt:
    """One try to do a request."""

    def __init__(self, this: Repeatable, claim: Claim, request: Request, receive: Receive, send: Send) -> None:
        self._this = this
        self._claim = claim
        self._request = request
        self._receive = receive
        self._send = send
        self._fingerprint = _fingerprint(request)
        self._read = False
        self._differs = False
        self._start: Message | None = None
        self._body = bytearray()

    async def begin(self) -> None:
        """Compare a request without a body at once: nobody may ever read it."""
        if not _has_body(self._request):
            await self._finish_reading()

    async def run(self, app: ASGIApp) -> None:
        try:
            await app(self._request.scope, self._receive_watched, self._send_kept)
        except BaseException:  # also when the client leaves or the service stops
            await self._this.let_go()
            raise

    async def _receive_watched(self) -> Message:
        message = await self._receive()
        if message["type"] != "http.request" or self._read:
            return message
        self._fingerprint.add(message.get("body", b""))
        if not message.get("more_body", False):
            await self._finish_reading()
        return message

    async def _finish_reading(self) -> None:
        self._read = True
        fingerprint = self._fingerprint.value()
        try:
            self._this.require_same(self._claim, fingerprint)
        except ServiceError:
            self._differs = True
            await self._this.let_go()
            raise
        await self._this.note_fingerprint(fingerprint)

    async def _send_kept(self, message: Message) -> None:
        """Keep an answer before anybody sees it."""
        if message["type"] == "http.response.start":
            self._start = message
            return
        if self._start is None:
            await self._send(message)
            return
        self._body += message.get("body", b"")
        last = not message.get("more_body", False)
        if not last and len(self._body) <= LARGEST_ANSWER:
            return
        await self._settle(self._start)
        start, self._start = self._start, None
        await self._send(start)
        await self._send({**message, "body": bytes(self._body)})

    async def _read_unwanted(self) -> None:
        """Read a body that nobody has read; when it does not come, requests with the same key need not be the same."""
        timeout_s = cast("Settings", self._request.app.state.settings).body_timeout_s
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while not self._read and (await self._receive_watched())["type"] == "http.request":
                    pass

    async def _settle(self, start: Message) -> None:
        status = start["status"]
        if self._differs or status >= 500:
            await self._this.let_go()
        elif not 200 <= status < 300 or len(self._body) > LARGEST_ANSWER:
            await self._this.forget()
        else:
            await self._read_unwanted()
            headers = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in start["headers"]]
            # what must not be kept is told once
            body = self._request.scope["state"].get("body_to_keep", bytes(self._body))
            await self._this.keep(Answer(status, _without_length(headers), body))


def _makes_something(request: Request) -> bool:
    """Tell whether a request is one that must not be done twice; what continues an upload says itself where."""
    return request.method == "POST" and HEADER in request.headers and not request.scope["path"].startswith("/uploads/")


def _has_body(request: Request) -> bool:
    return request.headers.get("content-length", "0") != "0" or "transfer-encoding" in request.headers


def _key(request: Request) -> str:
    key = request.headers[HEADER].strip()
    if len(key) > 1 and key[0] == key[-1] == '"':  # a string of structured headers (RFC 9651)
        key = key[1:-1]
    if KEY.fullmatch(key) is None:
        detail = "it has 1 to 255 printable ASCII characters"
        raise InvalidRequestError(f"Idempotency-Key: {detail}", [FieldFault(pointer_to("Idempotency-Key"), detail)])
    return key


def _fingerprint(request: Request) -> Fingerprint:
    kind = HeaderMessage()
    kind["content-type"] = request.headers.get("content-type", "")
    boundary = kind.get_boundary() or "" if kind.get_content_maintype() == "multipart" else ""
    query = request.scope["query_string"].decode("latin-1")
    known = (request.method, request.scope["path"], query, media_type(request))
    telling = (f"{name}: {request.headers.get(name, '')}" for name in TELLING)
    return Fingerprint((*known, *telling), boundary.encode("utf-8", "replace"))


async def _again(request: Request, this: Repeatable, claim: Claim) -> Response | None:
    """Read a request that was done, to know that it is the same, and give its first answer."""
    fingerprint = _fingerprint(request)
    async for chunk in body_of(request):
        fingerprint.add(chunk)
    this.require_same(claim, fingerprint.value())
    answer = claim.answer
    if answer is None:
        return None
    response = Response(answer.body, answer.status)
    for name, value in answer.headers:
        response.headers.append(name, value)
    response.headers[REPLAYED] = "true"
    return response


def _without_length(headers: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    return [(name, value) for name, value in headers if name.lower() != "content-length"]


def _known(error: ServiceError | SQLAlchemyError, request: Request) -> ServiceError:
    return error if isinstance(error, ServiceError) else away(error, request.scope["path"])
