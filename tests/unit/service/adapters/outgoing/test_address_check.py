"""Tricks by which a stranger might lead the service to where it must not go: every one is refused."""

import asyncio
import socket
import threading
from collections.abc import Sequence
from typing import Any

import httpx
import pytest

from service.adapters.outgoing import pinned_http
from service.adapters.outgoing.address_check import is_public, parsed_address
from service.adapters.outgoing.http_callbacks import HttpCallbacks
from service.adapters.outgoing.pinned_http import checked_destinations, pinned_request
from service.adapters.outgoing.remote_sources import RemoteSources
from service.errors import AddressRefusedError
from service.settings import Settings

INSIDE = (
    *("127.0.0.1", "127.255.255.254", "10.1.2.3", "172.16.0.1", "172.31.255.255", "192.168.1.1", "0.0.0.0"),  # noqa: S104
    *("169.254.169.254", "100.64.0.1", "100.100.100.200", "168.63.129.16", "192.0.0.192", "192.0.2.1", "192.88.99.1"),
    *("198.18.0.1", "198.51.100.1", "203.0.113.1", "224.0.0.1", "224.0.1.1", "239.1.1.1", "240.0.0.1"),
    *("255.255.255.255", "::1", "::", "fe80::1", "fe80::1%eth0", "fec0::1", "fc00::1", "fd00:ec2::254", "ff02::1"),
    *("ff0e::1", "::ffff:127.0.0.1", "::ffff:10.0.0.1", "::ffff:8.8.8.8", "::127.0.0.1", "64:ff9b::a00:1"),
    *("64:ff9b:1::a00:1", "2002:7f00:1::", "2001:0:1::", "2001:db8::1", "3fff::1", "100::1", "5f00::1"),
    *("2606:4700::1%eth0", "localhost", ""),
)
FORMS = (
    *("file:///etc/passwd", "gopher://x.example/_GET", "ftp://x.example/a.e57", "ws://x.example/", "dict://x.example/"),
    *("javascript:alert(1)", "data:text/plain,x", "//x.example/a", "x.example/a", "https:x.example", "https://", ""),
    *("https://2130706433/", "https://0x7f000001/", "https://0x7f.0.0.1/", "https://0177.0.0.1/", "https://127.1/"),
    *("https://0/", "https://017700000001/", "https://127.0.0.1./", "https://1.2.3.4.5/", "https://256.1.1.1/"),
    *(
        "https://x.example.0x10/",
        "https://x.1/",
        "https://127\u30020\u30020\u30021/",
        "https://\uff11\uff12\uff17.0.0.1/",
    ),
    *("https://\u24dbocalhost/", "https://x\uff0eexample/", "https://%31%32%37.0.0.1/", "https://x%00.example/"),
    *("https://me@x.example/", "https://me:secret@x.example/", "https://x.example@127.0.0.1/", "https://@x.example/"),
    *("https://x.example\\@127.0.0.1/", "https://x.example#@127.0.0.1/", "https://x.example/#part"),
    *(
        "https://x.example\r\nHost: y/",
        "https://x.example/\r\nX-Evil: 1",
        "https://x.example/a\nb",
        "https://x .example/",
    ),
    *("https://x.example/\ta", " https://x.example/", "https://x.example/\u2028", "https://x.example/\x00"),
    *("https://[::1", "https://[fe80::1%25eth0]/", "https://[::1].x.example/", "https://::1/", "https://[127.0.0.1]/"),
    *("https://x..example/", "https://.x.example/", "https://-x.example/", "https://x/" + "a" * 3000),
    *("https://x.example:0/", "https://x.example:65536/", "https://x.example:-1/", "https://x.example:80x/"),
)


@pytest.mark.parametrize("address", INSIDE)
def test_addresses_inside_are_not_public(address: str) -> None:
    assert not is_public(address)


@pytest.mark.parametrize("address", ["93.184.215.14", "8.8.8.8", "2606:2800:21f:cb07:6820:80da:af6b:8b2c"])
def test_addresses_outside_are_public(address: str) -> None:
    assert is_public(address)


@pytest.mark.parametrize("href", FORMS)
def test_an_address_that_can_be_read_in_two_ways_is_refused(href: str) -> None:
    with pytest.raises(AddressRefusedError):
        parsed_address(href)


@pytest.mark.parametrize("href", [*FORMS, *(f"https://{host}/" for host in ("127.0.0.1", "[::1]", "localhost."))])
def test_neither_callbacks_nor_sources_take_such_addresses(href: str) -> None:
    settings = Settings(allowed_sources="https://x.example/, s3://x.example, https://127.0.0.1/")
    with pytest.raises(AddressRefusedError):
        asyncio.run(HttpCallbacks(settings).check(href))

    async def fetch() -> None:
        async with RemoteSources(settings).opened(href):
            pass

    with pytest.raises(AddressRefusedError):
        asyncio.run(fetch())


@pytest.mark.parametrize(
    ("href", "host", "port"),
    [
        ("https://hooks.example.org/a?key=1", "hooks.example.org", None),
        ("HTTP://Hooks.Example.org:8080/a", "hooks.example.org", 8080),
        ("https://xn--bcher-kva.example/a%20b", "xn--bcher-kva.example", None),
        ("https://8.8.8.8/", "8.8.8.8", None),
        ("https://[2606:2800:21f::1]/", "2606:2800:21f::1", None),
        ("https://hooks_1.example.org./", "hooks_1.example.org.", None),
        ("https://example.org/b\u00fccher.e57", "example.org", None),
    ],
)
def test_usual_addresses_are_read(href: str, host: str, port: int | None) -> None:
    url = parsed_address(href)
    assert (url.raw_host.decode(), url.port) == (host, port)


def resolves_to(monkeypatch: pytest.MonkeyPatch, *answers: list[str]) -> list[str]:
    """Let every question for a host be answered by the next of the answers, and note who was asked for."""
    asked: list[str] = []
    coming = iter(answers)

    def resolve(host: str | bytes | None, port: Any = None, *_a: Any, **_k: Any) -> list[Any]:
        name = host.decode() if isinstance(host, bytes) else str(host)
        if name.replace(".", "").isdigit():  # the connection asks for what was resolved already
            return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (name, port))]
        asked.append(name)
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, port)) for address in next(coming)]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    return asked


def destinations(href: str, allow_private: bool = False) -> Sequence[str]:
    return asyncio.run(checked_destinations(parsed_address(href), allow_private=allow_private))


@pytest.mark.parametrize("found", [["10.0.0.1"], ["93.184.215.14", "10.0.0.1"], ["169.254.169.254"], ["fd00:ec2::254"]])
def test_a_name_that_leads_inside_is_refused(monkeypatch: pytest.MonkeyPatch, found: list[str]) -> None:
    resolves_to(monkeypatch, found)
    with pytest.raises(AddressRefusedError, match="public internet"):
        destinations("https://rebound.example/")


def test_names_whose_servers_never_answer_hold_up_no_other_work(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = threading.Event()

    def resolve(*_a: Any, **_k: Any) -> list[Any]:
        answer.wait(30.0)
        return []

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    monkeypatch.setattr(pinned_http, "RESOLVE_WITHIN_S", 0.3)

    async def ask() -> None:
        urls = [parsed_address(f"https://silent{number}.example/") for number in range(40)]
        asked = [asyncio.create_task(checked_destinations(url, allow_private=False)) for url in urls]
        await asyncio.sleep(0)
        assert await asyncio.to_thread(lambda: "done") == "done"
        for refused in await asyncio.gather(*asked, return_exceptions=True):
            assert isinstance(refused, AddressRefusedError)
            assert "not found within" in str(refused)

    try:
        asyncio.run(ask())
    finally:
        answer.set()


def test_a_name_without_an_address_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    resolves_to(monkeypatch, [])
    with pytest.raises(AddressRefusedError, match="no address"):
        destinations("https://nowhere.example/")


def test_a_name_that_nobody_knows_is_refused_in_the_words_of_one_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_arguments: Any, **_more: Any) -> Any:
        raise socket.gaierror(-2, "Name or service not known")

    said = set()
    resolves_to(monkeypatch, ["10.0.0.7"])
    with pytest.raises(AddressRefusedError) as inside:
        destinations("https://a.example/")
    said.add(str(inside.value))
    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(AddressRefusedError) as nowhere:
        destinations("https://a.example/")
    assert {str(nowhere.value)} == said


@pytest.mark.parametrize(
    "address",
    [
        "169.254.169.254",
        "169.254.170.2",
        "fe80::1",
        "::ffff:169.254.169.254",
        "64:ff9b::a9fe:a9fe",
        "2002:a9fe:a9fe::1",
        "fd00:ec2::254",
        "100.100.100.200",
        "192.0.0.192",
    ],
)
def test_what_a_cloud_tells_the_machine_is_for_no_stranger_even_where_private_addresses_are_allowed(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    resolves_to(monkeypatch, [address])
    with pytest.raises(AddressRefusedError, match="may be reached"):
        destinations("https://metadata.example/", allow_private=True)


def test_an_address_of_the_link_besides_keeps_nobody_from_a_server_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    resolves_to(monkeypatch, ["fe80::1", "192.168.1.7"])
    assert destinations("https://server.example/", allow_private=True) == ["192.168.1.7"]


@pytest.mark.parametrize(
    "host",
    ["localhost", "localhost.", "127.0.0.1", "[::1]", "[::ffff:127.0.0.1]", "[::]", "0.0.0.0"],  # noqa: S104
)
def test_this_machine_is_refused_however_it_is_written(host: str) -> None:
    with pytest.raises(AddressRefusedError, match=r"public internet|cannot be resolved"):
        destinations(f"https://{host}/")


def test_addresses_inside_are_taken_where_the_operator_allows_them() -> None:
    assert destinations("https://127.0.0.1/", allow_private=True) == ["127.0.0.1"]


def test_the_connection_goes_to_the_address_that_was_checked_though_the_name_leads_elsewhere_by_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as elsewhere:
        port = elsewhere.getsockname()[1]
        connected: list[Any] = []
        resolves_to(monkeypatch, ["93.184.215.14"], ["127.0.0.1"])

        async def connect(_loop: Any, _sock: socket.socket, address: Any) -> None:
            connected.append(address)
            raise ConnectionRefusedError

        monkeypatch.setattr(asyncio.selector_events.BaseSelectorEventLoop, "sock_connect", connect)

        async def send() -> None:
            url = parsed_address(f"http://rebound.example:{port}/")
            async with pinned_request("GET", url, allow_private=False, timeouts=httpx.Timeout(2.0), headers={}):
                pass

        with pytest.raises(httpx.ConnectError):
            asyncio.run(send())
        assert connected == [("93.184.215.14", port)]


def test_another_address_of_the_same_name_is_tried_when_the_first_is_out_of_reach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    connected: list[Any] = []

    async def connect(_loop: Any, _sock: socket.socket, address: Any) -> None:
        connected.append(address[0])
        raise ConnectionRefusedError

    resolves_to(monkeypatch, ["93.184.215.14", "93.184.215.14", "93.184.215.15"])
    monkeypatch.setattr(asyncio.selector_events.BaseSelectorEventLoop, "sock_connect", connect)

    async def send() -> None:
        url = parsed_address("http://two.example/")
        async with pinned_request("GET", url, allow_private=False, timeouts=httpx.Timeout(2.0), headers={}):
            pass

    with pytest.raises(httpx.ConnectError):
        asyncio.run(send())
    assert connected == ["93.184.215.14", "93.184.215.15"]
