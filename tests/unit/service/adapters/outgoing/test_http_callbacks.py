"""Posts to receivers: what is refused, and receivers that do not behave."""

import asyncio
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager

import pytest

from service.adapters.outgoing.http_callbacks import HttpCallbacks
from service.errors import AddressRefusedError
from service.ports import CallbackBody
from service.settings import Settings
from tests.measures.patience import patience

INSIDE = ("127.0.0.1", "localhost", "[::1]", "10.0.0.1", "169.254.169.254", "[fd00:ec2::254]", "[::ffff:10.0.0.1]")


async def pieces() -> AsyncIterator[bytes]:
    yield b'{"a": '
    yield b"1}"


def send(callbacks: HttpCallbacks, uri: str) -> int:
    return asyncio.run(callbacks.send(uri, {"webhook-id": "j_success"}, CallbackBody(8, pieces)))


def callbacks(**settings: object) -> HttpCallbacks:
    return HttpCallbacks(Settings(**{"callback_ports": "", "callback_timeout_s": 1, **settings}))  # type: ignore[arg-type]


@contextmanager
def answering(*parts: bytes, pause_s: float = 0.0) -> Iterator[tuple[str, list[bytes]]]:
    """Answer one request with these bytes, with a pause after each part; note the request."""
    requests: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            with connection:
                while b'{"a": 1}' not in b"".join(requests):
                    requests.append(connection.recv(65536))
                try:
                    for part in parts:
                        connection.sendall(part)
                        time.sleep(pause_s)
                except OSError:
                    requests.append(b"hung up")

        thread = threading.Thread(target=answer)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}/hook?key=1", requests
        thread.join()


@pytest.mark.parametrize("host", INSIDE)
def test_addresses_inside_are_refused_when_a_job_is_submitted(host: str) -> None:
    with pytest.raises(AddressRefusedError, match="public internet"):
        asyncio.run(callbacks().check(f"https://{host}/"))


@pytest.mark.parametrize("host", INSIDE)
def test_addresses_inside_are_refused_when_it_is_told(host: str) -> None:
    with pytest.raises(AddressRefusedError, match="public internet"):
        send(callbacks(), f"https://{host}/")


@pytest.mark.parametrize("uri", ["https://8.8.8.8:22/", "http://8.8.8.8:6379/", "https://8.8.8.8:25/x"])
def test_other_ports_are_refused(uri: str) -> None:
    with pytest.raises(AddressRefusedError, match="ports 80, 443"):
        asyncio.run(callbacks(callback_ports="80, 443").check(uri))


@pytest.mark.parametrize("uri", ["https://8.8.8.8/", "http://8.8.8.8/", "https://8.8.8.8:443/x", "http://8.8.8.8:443/"])
def test_allowed_ports_pass(uri: str) -> None:
    asyncio.run(callbacks(callback_ports="80, 443").check(uri))


def test_the_message_arrives_whole_with_its_headers() -> None:
    with answering(b"HTTP/1.1 202 Accepted\r\nContent-Length: 0\r\n\r\n") as (uri, requests):
        assert send(callbacks(allow_private_callbacks=True), uri) == 202
    head, _, body = b"".join(requests).partition(b"\r\n\r\n")
    lines = head.decode().splitlines()
    assert lines[0] == "POST /hook?key=1 HTTP/1.1"
    assert {"Content-Type: application/json", "Content-Length: 8", "webhook-id: j_success"} <= set(lines)
    assert f"Host: {uri.split('/')[2]}" in lines
    assert body == b'{"a": 1}'


def test_a_redirect_is_an_answer_and_not_followed() -> None:
    with answering(b"HTTP/1.1 307 T\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\n\r\n") as (uri, _):
        assert send(callbacks(allow_private_callbacks=True), uri) == 307


def test_what_a_receiver_says_at_length_is_not_listened_to() -> None:
    with answering(b"HTTP/1.1 200 OK\r\n\r\n", *[b"x" * 65536] * 400) as (uri, requests):
        assert send(callbacks(allow_private_callbacks=True), uri) == 200
    assert requests[-1] == b"hung up"


def test_a_receiver_that_answers_letter_by_letter_is_left_in_time() -> None:
    begin = time.monotonic()
    with (
        answering(*[b"H", b"T", b"T", b"P"] * 10, pause_s=0.1) as (uri, requests),
        pytest.raises(AddressRefusedError, match="within 1 s"),
    ):
        send(callbacks(allow_private_callbacks=True), uri)
    assert time.monotonic() - begin < 5.0 * patience()
    assert requests[-1] == b"hung up"


@pytest.mark.parametrize("answer", [b"", b"nonsense\r\n\r\n", b"HTTP/1.1 200 OK\r\n" + b"x-long: " + b"y" * 200_000])
def test_a_receiver_that_speaks_no_http_was_not_reached(answer: bytes) -> None:
    with (
        answering(answer) as (uri, _),
        pytest.raises(AddressRefusedError, match="not reached"),
    ):
        send(callbacks(allow_private_callbacks=True), uri)


def test_a_receiver_that_is_not_there_is_told() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        uri = f"http://127.0.0.1:{probe.getsockname()[1]}/"
    with pytest.raises(AddressRefusedError, match="not reached"):
        send(callbacks(allow_private_callbacks=True), uri)
