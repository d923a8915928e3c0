"""PostgreSQL has few connections, and they are all taken: nothing fails, and little is asked of an idle service."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import httpx
import psycopg
import pytest

from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.measures.patience import patience
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = [pytest.mark.service, pytest.mark.timeout(900)]

MOST, WORKERS = 18, 3
WITHIN_S = 300.0


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    with postgres_server(max_connections=str(MOST)) as made:
        yield made


@pytest.fixture(scope="module")
def url(server: PostgresServer) -> str:
    return server.new_database()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, url: str) -> Iterator[RunningService]:
    home: Path = tmp_path_factory.mktemp("full")
    settings = {"DATABASE_URL": url, "WORKERS": str(WORKERS), "SLOTS": "1"}
    with running_service(home, **settings) as made:
        wait_until(lambda: len(made.workers()) == WORKERS, WITHIN_S)
        yield made


@contextmanager
def nothing_left(url: str) -> Iterator[None]:
    """Take all connections that are free."""
    with ExitStack() as taken:
        with suppress(psycopg.OperationalError):
            while True:
                taken.enter_context(psycopg.connect(url, connect_timeout=5))
        yield


def test_an_idle_service_asks_little_and_holds_few_connections(
    service: RunningService, server: PostgresServer, url: str
) -> None:
    assert service.echo()
    time.sleep(8.0)  # until its workers have nothing that keeps them awake
    before, began = server.transactions(url), time.monotonic()
    time.sleep(15.0)
    rate = (server.transactions(url) - before) / (time.monotonic() - began)
    connections = server.connections()
    print(f"{WORKERS} idle workers and an API process: {rate:.1f} transactions/s, {connections} connections")
    assert rate / WORKERS <= 5.0
    assert connections <= 4 * (WORKERS + 1)


def test_while_all_connections_are_taken_requests_are_answered_and_no_job_fails(
    service: RunningService, url: str
) -> None:
    lasting = service.lasting_processes()
    with nothing_left(url):
        jobs = [service.execute("echo", {"stringInput": "x"}, Prefer="respond-async") for _ in range(12)]
        answers = [httpx.get(f"{service.url}/jobs/{job}", timeout=60.0 * patience()).status_code for job in jobs]
        assert answers == [200] * 12
    assert [service.finished(job, WITHIN_S)["status"] for job in jobs] == ["successful"] * 12
    assert service.lasting_processes() == lasting


def test_workers_that_start_while_there_is_no_connection_wait_for_one(service: RunningService, url: str) -> None:
    old = {process.pid for process in service.workers()}
    for worker in service.workers():
        worker.kill()
    with nothing_left(url):
        wait_until(lambda: len({process.pid for process in service.workers()} - old) == WORKERS, WITHIN_S)
        started = {process.pid for process in service.workers()}
        wait_until(lambda: "too many clients" in service.log, WITHIN_S)  # the database's own words
    assert service.echo()
    assert {process.pid for process in service.workers()} == started
