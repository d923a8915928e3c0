"""Clients that send next to nothing, never end, or do not read: given up in bounded time, while others are answered."""

import socket
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import httpx
import psutil
import pytest

from tests.e2e.files.broken_uploads import PART, begun, watched_memory, write_scan
from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.measures.patience import patience

pytestmark = pytest.mark.service

TIMEOUT_S = 3.0
"""Of heads and of bodies."""
PATIENCE_S = 30.0
SILENT = 500
SIZE = 8_000_000


@dataclass(frozen=True)
class Attack:
    """What a client sends."""

    at_once: bytes
    then: bytes = b""
    """Again and again."""
    every_s: float = 0.1


@dataclass(frozen=True)
class Outcome:
    """What became of it."""

    answer: bytes
    lasted_s: float
    """Until the service closed the connection."""

    @property
    def status(self) -> int | None:
        """None: closed without a word."""
        return int(self.answer.split()[1]) if self.answer else None


def connected(url: str) -> socket.socket:
    address = httpx.URL(url)
    return socket.create_connection((address.host, address.port or 80), timeout=10.0 * patience())


def outcome_of(url: str, attack: Attack) -> Outcome:
    answer, begin = b"", time.monotonic()
    with connected(url) as connection, suppress(ConnectionError):
        connection.sendall(attack.at_once)
        connection.settimeout(attack.every_s)
        for piece in repeat(attack.then):
            try:
                got = connection.recv(65536)
            except TimeoutError:
                assert time.monotonic() - begin < PATIENCE_S * patience()
                connection.sendall(piece)
                continue
            if not got:
                break
            answer += got
    return Outcome(answer, time.monotonic() - begin)


FORM = b'--X\r\nContent-Disposition: form-data; name="file"; filename="a.xyz"\r\n\r\n'
JSON, FORMED, RAW = (
    "application/json",
    "multipart/form-data; boundary=X",
    'application/octet-stream\r\nContent-Disposition: attachment; filename="a.xyz"',
)


def posted(path: str, kind: str, body: bytes = b"", more: str = "") -> bytes:
    head = (
        f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\nContent-Length: 1000000000\r\n{more}\r\n"
    )
    return head.encode() + body


KEYED = "Idempotency-Key: slow\r\nTus-Resumable: 1.0.0\r\nUpload-Length: 6\r\nUpload-Metadata: filename YS54eXo=\r\n"
START = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"
MANY = b"".join(b"X-%d: %d\r\n" % (k, k) for k in range(10_000))
SLOW: Mapping[str, Attack] = {
    "a head byte by byte": Attack(START, b"X"),
    "a head line by line": Attack(START, b"X-Y: z\r\n"),
    "a second head byte by byte": Attack(START + b"\r\n" + START, b"X"),
    "a request line byte by byte": Attack(b"", b"G"),
    "a raw body that stops": Attack(posted("/files", RAW, b"1 2 3\n")),
    "a raw body byte by byte": Attack(posted("/files", RAW), b"1"),
    "a form that stops": Attack(posted("/files", FORMED, FORM)),
    "a form byte by byte": Attack(posted("/files", FORMED, FORM), b"1"),
    "a registration that stops": Attack(posted("/registrations", FORMED, FORM.replace(b'"file"', b'"scan"'))),
    "a request that stops": Attack(posted("/processes/echo/execution", JSON, b'{"inputs"').replace(b"0" * 9, b"00")),
    "an unwanted body byte by byte": Attack(posted("/nothing", RAW), b"1"),
    "an unwanted body that stops": Attack(posted("/nothing", RAW, b"1")),
    "an unwanted body with a key": Attack(posted("/uploads", "text/plain", more=KEYED), b"1"),
    "chunks byte by byte": Attack(
        posted("/files", RAW).replace(b"Content-Length: 1000000000", b"Transfer-Encoding: chunked"), b"1\r\n2\r\n"
    ),
    "a chunk whose length never ends": Attack(
        posted("/files", RAW).replace(b"Content-Length: 1000000000", b"Transfer-Encoding: chunked"), b"0"
    ),
}
FLOODS: Mapping[str, Attack] = {
    "ten thousand headers": Attack(START + MANY + b"\r\n"),
    "ten thousand headers one after the other": Attack(START + MANY[:1000], MANY[1000:6000], 0.001),
    "a header of 1 MB": Attack(START + b"X: " + b"y" * 1_000_000 + b"\r\n\r\n"),
    "a header name of 1 MB": Attack(START + b"X" * 1_000_000),
    "a request line of 1 MB": Attack(b"GET /" + b"a" * 1_000_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n"),
    "a query of 1 MB": Attack(b"GET /jobs?limit=" + b"1" * 1_000_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n"),
    "no end of a header": Attack(START + b"X: ", b"y" * 10_000, 0.001),
    "a head of one chunk that is just too long": Attack(START + b"X: y\r\n" * 200 + b"\r\n"),
}


@dataclass(frozen=True)
class Siege:
    """All of them at once, and how others fared meanwhile."""

    outcomes: Mapping[str, Outcome]
    longest_answer_s: float
    largest_memory: int
    memory_before: int
    left: set[str]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    home = tmp_path_factory.mktemp("besieged")
    timeout = str(int(TIMEOUT_S))
    with running_service(home, HEADER_TIMEOUT_S=timeout, BODY_TIMEOUT_S=timeout, WORKERS="1") as running:
        yield running


def open_connections(service: RunningService) -> int:
    found = service.apis()[0].net_connections("tcp")
    return sum(each.status in {psutil.CONN_ESTABLISHED, psutil.CONN_CLOSE_WAIT} for each in found)


@pytest.fixture(scope="module")
def stored(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Give the path of a large download."""
    return f"/files/{service.upload(write_scan(tmp_path_factory.mktemp('scan') / 'a.las', SIZE))['id']}/content"


def tus_patch(service: RunningService, path: Path, body: bytes) -> bytes:
    headers = {**PART, "Host": "a", "Upload-Offset": "0", "Content-Length": str(SIZE)}
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    return f"PATCH {begun(service, path)} HTTP/1.1\r\n{head}\r\n".encode() + body


@pytest.fixture(scope="module")
def siege(service: RunningService, stored: str, tmp_path_factory: pytest.TempPathFactory) -> Siege:
    before, memory_before = service.stored(), service.apis()[0].memory_info().rss
    scan = write_scan(tmp_path_factory.mktemp("sent") / "b.las", SIZE)
    attacks = {
        **SLOW,
        "a PATCH that stops": Attack(tus_patch(service, scan, b"LASF")),
        "a PATCH byte by byte": Attack(tus_patch(service, scan, b"LASF"), b"1"),
    }
    longest_s = 0.0
    with ExitStack() as stack, watched_memory(service) as largest:
        for _ in range(SILENT):
            stack.enter_context(connected(service.url))
        for _ in range(10):
            deaf = stack.enter_context(connected(service.url))
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            deaf.sendall(f"GET {stored} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        pool = stack.enter_context(ThreadPoolExecutor(len(attacks)))
        running = {name: pool.submit(outcome_of, service.url, attack) for name, attack in attacks.items()}
        while not all(each.done() for each in running.values()):
            begin = time.monotonic()
            assert httpx.get(f"{service.url}/jobs", timeout=60.0 * patience()).status_code == 200
            longest_s = max(longest_s, time.monotonic() - begin)
            time.sleep(0.05)
        wait_until(lambda: open_connections(service) == 0, 4.0 * TIMEOUT_S)
    outcomes = {name: each.result() for name, each in running.items()}
    return Siege(outcomes, longest_s, largest[0], memory_before, service.stored() - before)


@pytest.mark.parametrize("name", [*SLOW, "a PATCH that stops", "a PATCH byte by byte"])
def test_slow_clients_are_given_up(siege: Siege, name: str) -> None:
    assert TIMEOUT_S - 0.5 < siege.outcomes[name].lasted_s < 5.0 * TIMEOUT_S * patience()


@pytest.mark.parametrize("name", [name for name in SLOW if "un" not in name and ("stops" in name or "body" in name)])
def test_they_are_told_why_when_a_request_has_begun(siege: Siege, name: str) -> None:
    assert siege.outcomes[name].status == 408


def test_others_are_answered_meanwhile(siege: Siege) -> None:
    assert siege.longest_answer_s < 2.0 * patience()


def test_memory_keeps_within_bounds(siege: Siege) -> None:
    print(f"\n{siege.memory_before / 1e6:.0f} MB before, {siege.largest_memory / 1e6:.0f} MB at most")
    assert siege.largest_memory - siege.memory_before < 60e6


def test_nothing_is_left_but_uploads_that_may_go_on(siege: Siege) -> None:
    assert {name.split("/")[1] for name in siege.left} == {"uploads"}
    # two that were begun, and the one whose POST had an unwanted body
    assert len({name.split("/")[2] for name in siege.left}) == 3


@pytest.mark.parametrize("name", FLOODS)
def test_heads_without_end_are_refused_at_once(service: RunningService, name: str) -> None:
    outcome = outcome_of(service.url, FLOODS[name])
    assert outcome.status in {400, 431, None}
    assert outcome.lasted_s < TIMEOUT_S


def test_a_refused_head_has_a_problem_document(service: RunningService) -> None:
    answer = outcome_of(service.url, FLOODS["a head of one chunk that is just too long"]).answer
    assert answer.startswith(b"HTTP/1.1 431 ")
    assert b"application/problem+json" in answer
    assert b'"status": 431' in answer


def test_the_service_goes_on(service: RunningService, siege: Siege) -> None:  # noqa: ARG001 - afterwards
    body = {"inputs": {"stringInput": "still here"}}
    assert service.post("/processes/echo/execution", json=body).json() == {"stringInput": "still here"}
    assert len(service.apis()) == 1
    assert "Traceback" not in service.log
