"""HTTP connections that are given up when their clients keep the service waiting, or send heads without end.

The web server itself waits for ever: for the first byte, for the rest of a request's head, for the rest of a body that
nobody wants, for a client that does not read its answer. Bodies that are read have limits of their own
(`service.use_cases.limits.patient_reading`).
"""

import asyncio
import json
import resource
from http import HTTPStatus
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_HEADERS = 200
LARGEST_HEAD = 65_536
"""Bytes of the request line and all headers."""
MOST_WAITING = 2000
"""Connections without a whole request; when there are more, the one that has waited longest is given up at once."""
MOST_FILES = 65_536


class ImpatientConnection(H11Protocol):
    """A connection of one client; `with_limits` says how long it may last without anything happening."""

    head_timeout_s: ClassVar[float]
    read_timeout_s: ClassVar[float]
    waiting: ClassVar[dict["ImpatientConnection", asyncio.TimerHandle]]
    """Those whose clients owe the rest of something, and when they are given up; the oldest first."""

    @classmethod
    def with_limits(cls, head_timeout_s: float, read_timeout_s: float) -> type["ImpatientConnection"]:
        """Give the connections of one server.

        Parameters
        ----------
        head_timeout_s
            For a request up to the end of its headers, and for what is left of a body that was answered already.
        read_timeout_s
            Longest time in which a client reads nothing of its answer.
        """
        limits: dict[str, Any] = {"head_timeout_s": head_timeout_s, "read_timeout_s": read_timeout_s, "waiting": {}}
        return type(cls.__name__, (cls,), limits)

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.conn: _StrictReader = _StrictReader(h11.SERVER, LARGEST_HEAD)
        self._stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as the server has it
        """Begin to wait for a request."""
        super().connection_made(transport)
        if len(self.waiting) >= MOST_WAITING:
            next(iter(self.waiting))._give_up()  # noqa: SLF001 - one of its own kind
        self._look()

    def data_received(self, data: bytes) -> None:
        """Take what comes."""
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        """Wait for the rest of the request, if it was answered early, or for the next one."""
        super().on_response_complete()
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing any more."""
        super().connection_lost(exc)
        self._wait_no_more()
        self.resume_writing()

    def pause_writing(self) -> None:
        """Begin to watch whether the client reads."""
        super().pause_writing()
        self._watch(-1)

    def resume_writing(self) -> None:
        """Go on: it has read."""
        super().resume_writing()
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no request, or too much of one."""
        status = HTTPStatus(self.conn.refused_with)
        problem = {"type": "about:blank", "title": status.phrase, "status": status.value, "detail": msg}
        headers = [("content-type", "application/problem+json"), ("connection", "close")]
        answer = h11.Response(status_code=status.value, headers=headers, reason=status.phrase.encode())
        for event in (answer, h11.Data(data=json.dumps(problem).encode()), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _look(self) -> None:
        """Wait, from when it began to be owed, for a request, an unwanted body, or the last answer to be read."""
        state = self.conn.their_state
        unwanted = state is h11.SEND_BODY and self.conn.our_state is h11.DONE
        if not (state is h11.IDLE or unwanted or self.transport.is_closing()):
            self._wait_no_more()
        elif self not in self.waiting:
            self.waiting[self] = self.loop.call_later(self.head_timeout_s, self._give_up)

    def _wait_no_more(self) -> None:
        timer = self.waiting.pop(self, None)
        if timer is not None:
            timer.cancel()

    def _give_up(self) -> None:
        self._wait_no_more()
        self.transport.abort()

    def _watch(self, left_before: int) -> None:
        left = self.transport.get_write_buffer_size()
        if left == left_before:
            self.transport.abort()
        else:
            self._stalled = self.loop.call_later(self.read_timeout_s, self._watch, left)


class _StrictReader(h11.Connection):
    """Read requests whose heads have bounds, also when they come all at once."""

    refused_with = 400

    def next_event(self) -> Any:
        """Give what comes next.

        Raises
        ------
        h11.RemoteProtocolError
            It is no request, or too much of one.
        """
        try:
            event = super().next_event()
            if isinstance(event, h11.Request):
                _require_bounded(event)
        except h11.RemoteProtocolError as error:
            self.refused_with = error.error_status_hint
            raise
        return event


def _require_bounded(request: h11.Request) -> None:
    size = len(request.target) + sum(len(name) + len(value) for name, value in request.headers)
    if len(request.headers) > MOST_HEADERS or size > LARGEST_HEAD:
        raise h11.RemoteProtocolError("the head of the request is too large", 431)


def allow_many_files() -> None:
    """Let this process have as many connections and files open as the system lets it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, MOST_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
