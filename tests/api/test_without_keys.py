"""A service that needs no keys answers who sits at its machine, and nobody who only made it look like that."""

import asyncio
from collections.abc import Mapping
from typing import Any

import httpx
import pytest

from service.dependencies import Adapters
from service.settings import Settings
from tests.api.conftest import Client, FakeSteps
from tests.api.key_service import KeyService
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

BOUND = "http://127.0.0.1:8765"
ECHO = b'{"inputs": {"pause": 0, "stringInput": "x"}}'


class Visitor:
    """Ask as if through a connection of this machine, with any header."""

    def __init__(self, app: Any, reached: str = BOUND, peer: tuple[str, int] = ("127.0.0.1", 50_000)) -> None:
        self._app, self._reached, self._peer = app, reached, peer

    def ask(self, method: str, path: str, headers: Mapping[str, str], content: bytes = b"") -> httpx.Response:
        async def send() -> httpx.Response:
            transport = httpx.ASGITransport(self._app, raise_app_exceptions=False, client=self._peer)
            async with httpx.AsyncClient(transport=transport, base_url=self._reached) as client:
                return await client.request(method, path, headers=dict(headers), content=content)

        return asyncio.run(send())


@pytest.fixture(scope="module")
def visitor(tmp_path_factory: pytest.TempPathFactory) -> Visitor:
    blobs = MemoryBlobStore()
    adapters = Adapters(MemoryJobStore(), MemoryFileStore(), blobs, MemoryQueue(), FakeSteps(blobs), MemoryJobLog())
    return Visitor(create_app(Settings(data_dir=tmp_path_factory.mktemp("open"), min_free_bytes=0), adapters))


@pytest.mark.parametrize(
    "host",
    [
        *("localhost", "LocalHost:8765", "localhost.", "localhost.:99", "127.0.0.1", "127.0.0.1:1", "127.8.9.10"),
        *("[::1]", "[::1]:8765", "[0:0:0:0:0:0:0:1]", "[::ffff:127.0.0.1]:8765"),
    ],
)
def test_loopback_is_served_however_it_is_written(visitor: Visitor, host: str) -> None:
    assert visitor.ask("GET", "/files", {"Host": host}).status_code == 200


FOREIGN = [
    *("rebind.example", "rebind.example:8765", "localhost.rebind.example", "127.0.0.1.nip.example", "xlocalhost"),
    *("localhost:8765@rebind.example", "rebind.example@localhost", "localhost:x", "", "192.168.0.7:8765", "10.0.0.1"),
    *("[::2]:8765", "localhost, rebind.example", "127.0.0.1:8765/x", "0.0.0.0:8765", "169.254.169.254"),
]


@pytest.mark.parametrize("host", FOREIGN)
@pytest.mark.parametrize("path", ["/files", "/jobs", "/", "/processes", "/readyz"])
def test_a_name_that_is_not_of_this_machine_reads_nothing(visitor: Visitor, host: str, path: str) -> None:
    refused = visitor.ask("GET", path, {"Host": host})
    assert refused.status_code == 403
    assert refused.headers["content-type"] == "application/problem+json"


def test_a_rebound_name_deletes_no_file(settings: Settings, adapters: Adapters) -> None:
    app = create_app(settings, adapters)
    file = Client(app).upload("kept.xyz")
    assert Visitor(app).ask("DELETE", f"/files/{file}", {"Host": "rebind.example:8765"}).status_code == 403
    assert adapters.files.get(file) is not None


def test_the_process_says_to_everybody_that_it_lives(visitor: Visitor) -> None:
    assert visitor.ask("GET", "/healthz", {"Host": "probe.example"}).status_code == 200


def test_the_bound_address_and_the_public_name_are_served(settings: Settings, adapters: Adapters) -> None:
    known = settings.model_copy(update={"host": "192.168.7.1", "public_url": "https://Scans.example.org./survey"})
    visitor = Visitor(create_app(known, adapters))
    assert visitor.ask("GET", "/files", {"Host": "192.168.7.1:8765"}).status_code == 200
    assert visitor.ask("GET", "/files", {"Host": "scans.example.org"}).status_code == 200
    assert visitor.ask("GET", "/files", {"Host": "other.example.org"}).status_code == 403


@pytest.mark.parametrize(
    "header",
    [
        *("Forwarded", "Via", "X-Forwarded-For", "X-Forwarded-Host", "X-Forwarded-Proto", "X-Forwarded-Server"),
        *("X-Forwarded-Anything", "X-Real-IP"),
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
def test_what_a_proxy_passes_on_is_refused(visitor: Visitor, header: str, method: str) -> None:
    assert visitor.ask(method, "/files", {header: "127.0.0.1"}).status_code == 403


def test_a_stated_proxy_lets_this_machine_through_and_nobody_else(settings: Settings, adapters: Adapters) -> None:
    app = create_app(settings, adapters)
    forwarded = {"X-Forwarded-For": "as the web server has read it", "Host": "localhost"}
    # the web server writes 0 for the port of a client that a stated proxy has named
    assert Visitor(app, peer=("127.0.0.1", 0)).ask("GET", "/files", forwarded).status_code == 200
    assert Visitor(app, peer=("203.0.113.5", 0)).ask("GET", "/files", forwarded).status_code == 403
    assert Visitor(app, peer=("127.0.0.1", 40_000)).ask("GET", "/files", forwarded).status_code == 403


def test_where_something_else_keeps_strangers_out_a_stated_proxy_is_taken_at_its_word(
    settings: Settings, adapters: Adapters
) -> None:
    open_on_purpose = settings.model_copy(update={"auth": "off", "public_url": "https://scans.example.org"})
    app = create_app(open_on_purpose, adapters)
    forwarded = {"X-Forwarded-For": "203.0.113.5", "Host": "scans.example.org"}
    assert Visitor(app, peer=("203.0.113.5", 0)).ask("GET", "/files", forwarded).status_code == 200
    assert Visitor(app, peer=("127.0.0.1", 40_000)).ask("GET", "/files", forwarded).status_code == 403


FOREIGN_PAGES = [
    {"Origin": "https://evil.example"},
    {"Origin": "null"},
    {"Origin": ""},
    {"Origin": "http://127.0.0.1:3000"},
    {"Origin": "https://127.0.0.1:8765"},
    {"Origin": "http://localhost:8765"},
    {"Origin": "http://127.0.0.1:8765.evil.example"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Sec-Fetch-Site": "same-site"},
    {"Sec-Fetch-Site": "anything"},
    {"Origin": BOUND, "Sec-Fetch-Site": "cross-site"},
]


@pytest.mark.parametrize("page", FOREIGN_PAGES, ids=str)
def test_a_page_of_another_origin_changes_nothing(visitor: Visitor, page: dict[str, str]) -> None:
    form = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.xyz"\r\n\r\n1 2 3\r\n--b--\r\n'
    sent = visitor.ask("POST", "/files", {**page, "Content-Type": "multipart/form-data; boundary=b"}, form)
    begun = visitor.ask("POST", "/processes/echo/execution", {**page, "Prefer": "respond-async"}, ECHO)
    assert (sent.status_code, begun.status_code) == (403, 403)
    assert visitor.ask("GET", "/files", {}).json()["numberMatched"] == 0
    assert visitor.ask("GET", "/jobs", {}).json()["numberMatched"] == 0


@pytest.mark.parametrize(
    "page",
    [
        {},
        {"Origin": BOUND},
        {"Origin": "HTTP://127.0.0.1:8765", "Sec-Fetch-Site": "same-origin"},
        {"Sec-Fetch-Site": "none"},
        {"Host": "localhost:8765", "Origin": "http://localhost:8765"},
        {"Host": "[::1]:8765", "Origin": "http://[::1]:8765"},
    ],
    ids=str,
)
def test_programs_and_the_own_page_are_served(visitor: Visitor, page: dict[str, str]) -> None:
    assert visitor.ask("POST", "/processes/echo/execution", page, ECHO).status_code == 200


def test_the_own_page_behind_the_public_name_is_served(settings: Settings, adapters: Adapters) -> None:
    known = settings.model_copy(update={"public_url": "https://scans.example.org"})
    visitor = Visitor(create_app(known, adapters))
    headers = {"Host": "scans.example.org", "Origin": "https://scans.example.org"}
    assert visitor.ask("POST", "/processes/echo/execution", headers, ECHO).status_code == 200
    assert (
        visitor.ask("POST", "/processes/echo/execution", {**headers, "Origin": "http://evil.example"}, ECHO).status_code
        == 403
    )


NOT_JSON = ["text/plain", "TEXT/PLAIN;charset=UTF-8", " text/plain ", "application/x-www-form-urlencoded"]
NOT_JSON += ["multipart/form-data; boundary=x", "multipart/mixed; boundary=x"]


@pytest.mark.parametrize("kind", NOT_JSON)
@pytest.mark.parametrize("keyed", [False, True])
def test_json_under_a_type_that_any_page_may_send_is_refused(
    settings: Settings, adapters: Adapters, kind: str, keyed: bool
) -> None:
    client = KeyService(settings, adapters).client("k") if keyed else Client(create_app(settings, adapters))
    answer = client.post("/processes/echo/execution", content=ECHO, headers={"Content-Type": kind})
    assert answer.status_code == 415


@pytest.mark.parametrize("kind", [None, "application/json", "application/json; charset=utf-8", "application/geo+json"])
def test_json_under_its_own_type_or_none_is_read(client: Client, kind: str | None) -> None:
    headers = {} if kind is None else {"Content-Type": kind}
    assert client.post("/processes/echo/execution", content=ECHO, headers=headers).status_code == 200


def test_with_keys_names_proxies_and_origins_do_not_matter(settings: Settings, adapters: Adapters) -> None:
    service = KeyService(settings, adapters)
    headers = {"Host": "scans.example.org", "Via": "1.1 proxy", "Origin": "https://page.example"}
    headers |= {"Authorization": f"Bearer {service.secret('k')}"}
    assert Visitor(service.app).ask("POST", "/processes/echo/execution", headers, ECHO).status_code == 200
