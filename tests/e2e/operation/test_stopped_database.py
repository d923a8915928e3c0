"""PostgreSQL is stopped in the middle of everything: it says nothing, and all requests are answered all the same."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from service.adapters.database.silent_servers import ANSWERS_WITHIN_S
from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.measures.patience import patience
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = pytest.mark.service

UPLOAD = {"Tus-Resumable": "1.0.0", "Upload-Length": "10", "Upload-Metadata": "filename YS54eXo="}
LATER = {"Prefer": "respond-async"}
REQUESTS = (
    ("GET", "/jobs", {}),
    ("GET", "/files", {}),
    ("POST", "/files", {"files": {"file": ("a.xyz", b"0 0 0\n1 1 1\n")}}),
    ("POST", "/uploads", {"headers": UPLOAD}),
    ("POST", "/processes/echo/execution", {"json": {"inputs": {"stringInput": "x"}}, "headers": LATER}),
    ("GET", "/readyz", {}),
)
LONGEST_S = ANSWERS_WITHIN_S + 5.0
CLIENTS = 30


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    with postgres_server() as made:
        yield made


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, server: PostgresServer) -> Iterator[RunningService]:
    settings = {"DATABASE_URL": server.new_database(), "WORKERS": "2", "SLOTS": "1"}
    with running_service(tmp_path_factory.mktemp("silent"), **settings) as made:
        yield made


def test_requests_are_refused_in_time_while_the_server_is_stopped_and_all_goes_on_afterwards(
    service: RunningService, server: PostgresServer
) -> None:
    def asked(number: int) -> tuple[str, httpx.Response, float]:
        method, path, what = REQUESTS[number % len(REQUESTS)]
        began = time.monotonic()
        answer = httpx.request(method, service.url + path, timeout=120.0, **what)
        return f"{method} {path}", answer, time.monotonic() - began

    lasting = service.lasting_processes()
    job = service.execute("echo", {"stringInput": "x", "pause": 8}, Prefer="respond-async")
    wait_until(lambda: service.job(job)["status"] == "running")
    with server.stopped(), ThreadPoolExecutor(CLIENTS + 1) as clients:
        first = [clients.submit(asked, number) for number in range(CLIENTS)]
        alive = []
        while not all(each.done() for each in first):
            began = time.monotonic()
            assert httpx.get(f"{service.url}/healthz", timeout=60.0).status_code == 200
            alive.append(time.monotonic() - began)
            time.sleep(0.2)
        waited = [each.result() for each in first]
        later = [asked(number) for number in range(2 * len(REQUESTS))]
    for name, answer, took_s in [*waited, *later]:
        print(f"{name}: {answer.status_code} after {took_s:.2f} s")
        assert answer.status_code == 503, f"{name}: {answer.text}"
        assert int(answer.headers["Retry-After"]) > 0
        assert "does not answer" in answer.text or "busy" in answer.text
        assert took_s < LONGEST_S * patience()
    # who comes later does not wait: it is known that the server is silent
    assert sorted(took_s for _, _, took_s in later)[len(later) // 2] < 1.0 * patience()
    assert max(alive) < 1.0 * patience()
    assert "the server was silent" in service.log
    wait_until(lambda: httpx.get(f"{service.url}/readyz", timeout=60.0).status_code == 200, 30.0)
    assert service.result(job)["stringInput"] == "x"
    assert service.job(job)["attempts"] == 1
    assert service.echo()
    assert service.lasting_processes() == lasting
