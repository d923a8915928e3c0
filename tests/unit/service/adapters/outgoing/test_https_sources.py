"""Files on other servers: only from where the operator allows, and never from inside the network by surprise."""

import asyncio
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from service.adapters.outgoing import https_sources
from service.adapters.outgoing.https_sources import HttpsSources
from service.errors import AddressRefusedError
from service.settings import Settings

LETTERS = b"abcdefghijklmnopqrstuvwxyz"


class Server(BaseHTTPRequestHandler):
    """Serve what the path says."""

    def do_GET(self) -> None:
        if self.path.startswith("/scans/moved"):
            self.send_response(302)
            self.send_header("Location", "http://127.0.0.1:1/secret.xyz")
            self.end_headers()
            return
        if self.path.startswith("/scans/breaking"):
            self.break_off()
            return
        if self.path.startswith("/scans/none"):
            self.send_error(404)
            return
        body = f"{self.headers['Host']} {self.headers['Accept-Encoding']}".encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body) + 5 * self.path.startswith("/scans/short")))
        self.end_headers()
        self.wfile.write(body)

    def break_off(self) -> None:
        """Send ten letters at a time, as often as it is asked to go on."""
        begin = int(self.headers.get("Range", "bytes=0-").removeprefix("bytes=").removesuffix("-"))
        goes_on = "deaf" not in self.path
        if begin and ("changed" in self.path or self.headers["If-Range"] != '"v1"'):
            begin = 0
        self.send_response(206 if begin else 200)
        self.send_header("Content-Length", str(len(LETTERS) - begin))
        if begin:
            self.send_header("Content-Range", f"bytes {begin}-{len(LETTERS) - 1}/{len(LETTERS)}")
        if goes_on:
            self.send_header("Accept-Ranges", "bytes")
        self.send_header("ETag", '"v1"')
        self.end_headers()
        self.wfile.write(LETTERS[begin : begin + 10])

    def log_message(self, *_arguments: Any) -> None:
        pass


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Server) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.server_address[1]}"
        running.shutdown()
        thread.join()


def sources(allowed: str, private: bool = False) -> HttpsSources:
    return HttpsSources(Settings(allowed_sources=allowed, allow_private_sources=private))


def fetched(found: HttpsSources, href: str) -> tuple[str, bytes]:
    async def fetch() -> tuple[str, bytes]:
        async with found.opened(href) as remote:
            return remote.name, b"".join([chunk async for chunk in remote.chunks])

    return asyncio.run(fetch())


@pytest.mark.parametrize(
    "href",
    [
        "http://example.org/scans/a.e57",
        "https://example.org/other/a.e57",
        "https://example.org/scansother/a.e57",
        "https://example.org:8443/scans/a.e57",
        "https://example.org.evil.net/scans/a.e57",
        "https://evil.net/scans/a.e57",
        "https://example.org/scans/../secret/a.e57",
        "https://example.org/scans/%2e%2e/secret/a.e57",
        "https://example.org/scans/..%5csecret/a.e57",
        "https://me:pass@example.org/scans/a.e57",
        "https://example.org@evil.net/scans/a.e57",
        "ftp://example.org/scans/a.e57",
        "file:///etc/passwd",
        "//example.org/scans/a.e57",
        "scans/a.e57",
        "https://",
        "https://[::1",
        "",
        "https://example.org/scans/" + "a" * 3000,
    ],
)
def test_only_addresses_below_an_allowed_beginning_are_fetched(href: str) -> None:
    with pytest.raises(AddressRefusedError):
        sources("https://example.org/scans/").check(href)


@pytest.mark.parametrize("href", ["https://example.org/scans/a.e57", "https://EXAMPLE.org:443/scans/b/a.e57?key=1"])
def test_addresses_below_an_allowed_beginning_pass(href: str) -> None:
    sources("https://other.net/, https://example.org/scans").check(href)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "0x7f000001", "2130706433", "[::1]", "[::ffff:7f00:1]"])
def test_a_host_inside_is_refused_however_it_is_written(host: str) -> None:
    with pytest.raises(AddressRefusedError, match=r"public internet|cannot be resolved|usual notation"):
        fetched(sources(f"https://{host}/"), f"https://{host}/a.e57")


def test_a_name_that_resolves_to_an_inner_address_besides_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, 443)) for address in ("93.184.215.14", "10.0.0.1")]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_a, **_k: found)
    with pytest.raises(AddressRefusedError, match="public internet"):
        fetched(sources("https://rebound.example/"), "https://rebound.example/a.e57")


def test_a_file_is_fetched_from_the_address_that_was_resolved_first(
    server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = int(server.rpartition(":")[2])
    asked: list[str] = []

    def resolve(host: str | bytes, *_a: Any, **_k: Any) -> list[Any]:
        asked.append(host if isinstance(host, str) else host.decode())
        if asked[-1] == "127.0.0.1" or len(asked) == 1:
            return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", port))]
        raise AssertionError("resolved twice")

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    href = f"http://scans.example:{port}/scans/a.xyz"
    name, content = fetched(sources(f"http://scans.example:{port}/", private=True), href)
    assert (name, content) == ("a.xyz", f"scans.example:{port} identity".encode())
    assert asked.count("scans.example") == 1


@pytest.mark.parametrize(
    ("path", "reason"),
    [("moved.xyz", "redirects"), ("none.xyz", "404"), ("short.xyz", "could not be fetched"), ("", "file's name")],
)
def test_what_is_not_there_whole_is_refused(server: str, path: str, reason: str) -> None:
    with pytest.raises(AddressRefusedError, match=reason):
        fetched(sources(f"{server}/", private=True), f"{server}/scans/{path}")


def test_a_download_that_breaks_goes_on_where_it_broke(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(https_sources, "FIRST_PAUSE_S", 0.01)
    name, content = fetched(sources(f"{server}/", private=True), f"{server}/scans/breaking.xyz")
    assert (name, content) == ("breaking.xyz", LETTERS)


@pytest.mark.parametrize(
    ("path", "reason"), [("breaking-deaf.xyz", "could not be fetched"), ("breaking-changed.xyz", "after 10 bytes")]
)
def test_a_download_that_cannot_go_on_is_refused(
    server: str, monkeypatch: pytest.MonkeyPatch, path: str, reason: str
) -> None:
    monkeypatch.setattr(https_sources, "FIRST_PAUSE_S", 0.01)
    with pytest.raises(AddressRefusedError, match=reason):
        fetched(sources(f"{server}/", private=True), f"{server}/scans/{path}")


def test_a_server_that_is_not_there_is_told() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        free = f"http://127.0.0.1:{probe.getsockname()[1]}"
    with pytest.raises(AddressRefusedError, match="could not be fetched"):
        fetched(sources(f"{free}/", private=True), f"{free}/a.xyz")
