"""What a service asks of its database, by number of workers: while it has nothing to do, and while it is busy.

uv run pytest -n0 -s -m benchmark tests/benchmark/test_database_load.py
"""

import time
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
import pytest

from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

NUMBERS = (1, 2, 4)
SETTLED_S, MEASURED_S = 8.0, 10.0
QUIET = 0.1
"""Share of a core that is taken by what has nothing to do, at most: not before libraries and kernels are loaded."""
JOBS = 40
COLUMNS = (
    "database",
    "workers",
    "connections, idle and busy",
    "transactions a second, idle",
    "transactions a job, busy",
    "of a core, idle",
    "processor time a job",
)


class Embedded:
    """A database in a file: who has it open is seen from outside, and what is done in it is not."""

    def __init__(self, service: RunningService) -> None:
        self._service = service

    def connections(self) -> int:
        found = 0
        for process in self._service.processes():
            folder = Path("/proc") / str(process.pid) / "fd"
            with suppress(OSError, psutil.NoSuchProcess):
                found += sum(path.readlink().name == "tieline.sqlite" for path in folder.iterdir())
        return found

    def transactions(self) -> int | None:
        return None


class Server:
    """A database of which the server tells."""

    def __init__(self, server: PostgresServer, url: str) -> None:
        self._server, self._url = server, url

    def connections(self) -> int:
        return self._server.connections()

    def transactions(self) -> int | None:
        return self._server.transactions(self._url)


def processor_s(service: RunningService) -> float:
    """Sum what all processes have taken of the processors, with those that have ended."""
    found = 0.0
    for process in service.processes():
        with suppress(psutil.NoSuchProcess):
            found += sum(process.cpu_times()[:4])
    return found


def share_of_core(service: RunningService, seconds: float) -> float:
    before, began = processor_s(service), time.monotonic()
    time.sleep(seconds)
    return (processor_s(service) - before) / (time.monotonic() - began)


def row(service: RunningService, database: Embedded | Server, kind: str, number: int) -> str:
    """Measure while nothing happens, then while jobs of one step pass through."""
    assert service.echo()
    wait_until(lambda: share_of_core(service, SETTLED_S) < QUIET, 600.0)
    transactions, taken_s, began = [database.transactions()], [processor_s(service)], time.monotonic()
    time.sleep(MEASURED_S)
    seconds = time.monotonic() - began
    transactions.append(database.transactions())
    taken_s.append(processor_s(service))
    idle, most = database.connections(), 0
    jobs = [service.execute("echo", {"stringInput": "x"}, Prefer="respond-async") for _ in range(JOBS)]
    while service.get("/jobs?status=accepted&status=running&limit=1").json()["jobs"]:
        most = max(most, database.connections())
        time.sleep(0.2)
    transactions.append(database.transactions())
    taken_s.append(processor_s(service))
    assert [service.job(job)["status"] for job in jobs] == ["successful"] * JOBS
    rate, each = ["", ""]
    if None not in transactions:
        first, second, third = (value or 0 for value in transactions)
        rate, each = f"{(second - first) / seconds:.1f}", f"{(third - second) / JOBS:.0f}"
        # one process more than there are workers: the API is counted as well
        assert max(idle, most) <= 4 * (number + 1)
        assert (second - first) / seconds <= 5.0 * number + 1.0
    share = f"{100 * (taken_s[1] - taken_s[0]) / seconds:.1f} %"
    cells = (kind, number, f"{idle}, {max(idle, most)}", rate, each, share)
    return f"| {' | '.join(map(str, cells))} | {1e3 * (taken_s[2] - taken_s[1]) / JOBS:.0f} ms |"


@pytest.mark.parametrize("kind", ["SQLite", "PostgreSQL"])
def test_what_a_service_asks_of_its_database(tmp_path: Path, kind: str) -> None:
    print(f"\n| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    with ExitStack() as running:
        server = running.enter_context(postgres_server()) if kind == "PostgreSQL" else None
        for number in NUMBERS if server is not None else NUMBERS[:1]:
            url = "" if server is None else server.new_database()
            with running_service(tmp_path / str(number), DATABASE_URL=url, WORKERS=str(number)) as service:
                wait_until(lambda service=service, number=number: len(service.workers()) == number, 300.0)  # type: ignore[misc]
                print(row(service, Embedded(service) if server is None else Server(server, url), kind, number))
