"""Connections without a request: too many of them push each other out, and none stays for ever."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest
import uvicorn
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

from service.adapters.web import impatient_server
from service.adapters.web.impatient_server import ImpatientConnection
from tests.measures.patience import patience

REQUEST = b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"
Work = Callable[[int], Awaitable[None]]


async def hello(_scope: Scope, _receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"5")]})
    await send({"type": "http.response.body", "body": b"hello"})


def with_server(work: Work, head_timeout_s: float = 60.0) -> None:
    async def serve() -> None:
        config, state = uvicorn.Config(hello, log_config=None), ServerState()
        connections = ImpatientConnection.with_limits(head_timeout_s, 60.0)
        loop = asyncio.get_running_loop()
        server = await loop.create_server(lambda: connections(config, state, {}), "127.0.0.1", 0)
        async with server, asyncio.timeout(20.0 * patience()):
            await work(server.sockets[0].getsockname()[1])
        assert connections.waiting == {}

    asyncio.run(serve())


async def ends(reader: asyncio.StreamReader) -> bool:
    return await reader.read() == b""


def test_those_that_have_waited_longest_make_room_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(impatient_server, "MOST_WAITING", 2)

    async def work(port: int) -> None:
        streams = [await asyncio.open_connection("127.0.0.1", port) for _ in range(4)]
        assert await ends(streams[0][0])
        assert await ends(streams[1][0])
        for reader, writer in streams[2:]:
            writer.write(REQUEST.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
            assert (await reader.read()).endswith(b"hello")
        for _, writer in streams:
            writer.close()
            await writer.wait_closed()

    with_server(work)


def test_whoever_asks_again_in_time_stays_connected() -> None:
    pause_s = 0.05 * patience()

    async def work(port: int) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for _ in range(6):
            await asyncio.sleep(pause_s)
            writer.write(REQUEST)
            assert (await reader.readuntil(b"hello")).startswith(b"HTTP/1.1 200 ")
        assert await ends(reader)
        writer.close()
        await writer.wait_closed()

    with_server(work, head_timeout_s=4.0 * pause_s)
