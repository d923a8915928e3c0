"""What a service that has nothing to do asks of PostgreSQL, by number of workers.

uv run pytest -n0 -s -m benchmark tests/benchmark/test_database_load.py
"""

import time
from pathlib import Path

import pytest

from tests.e2e.running_service import running_service, wait_until
from tests.servers.postgres_server import postgres_server

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

NUMBERS = (1, 2, 4)
SETTLED_S, MEASURED_S = 8.0, 10.0


def test_what_an_idle_service_asks_of_its_database(tmp_path: Path) -> None:
    print("\n| workers | connections | transactions per second |\n|---|---|---|")
    with postgres_server() as server:
        for number in NUMBERS:
            url = server.new_database()
            with running_service(tmp_path / str(number), DATABASE_URL=url, WORKERS=str(number)) as service:
                wait_until(lambda service=service, number=number: len(service.workers()) == number, 300.0)  # type: ignore[misc]
                assert service.echo()
                time.sleep(SETTLED_S)
                before, began = server.transactions(url), time.monotonic()
                time.sleep(MEASURED_S)
                rate = (server.transactions(url) - before) / (time.monotonic() - began)
                connections = server.connections()
            print(f"| {number} | {connections} | {rate:.1f} |")
            # one process more than there are workers: the API is counted as well
            assert rate <= 5.0 * number + 1.0
            assert connections <= 4 * (number + 1)
