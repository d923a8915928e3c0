"""The database server dies, or is silent, during jobs: they wait for it and go on; no finished step is repeated."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from engine_harness import Harness, alive, harness, wait_until

from service.ports import JobStatus
from tests.measures.patience import patience
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = pytest.mark.service

OUTAGE_S = 8.0
"""Longer than it takes until a silent worker counts as dead."""


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    with postgres_server() as made:
        yield made


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, server: PostgresServer) -> Iterator[Harness]:
    with harness(tmp_path_factory.mktemp("outage"), database_url=server.new_database()) as made:
        for slot in ("0", "1"):
            made.start_worker(slot)
        wait_until(lambda: made.queue.live_workers() == 2)
        yield made


@pytest.mark.parametrize("how", ["killed", "stopped", "silent"])
def test_jobs_outlast_an_outage(service: Harness, server: PostgresServer, how: str) -> None:
    jobs = [
        service.submit(
            [{"step": "nap", "seconds": 0.1, "name": f"{how}-{name}-first"}],
            # one ends in the middle of the outage, one after it
            [{"step": "nap", "seconds": seconds, "name": f"{how}-{name}-second"}],
            [{"step": "nap", "seconds": 0.1, "name": f"{how}-{name}-third"}],
        )
        for name, seconds in (("during", 3.0), ("after", OUTAGE_S + 4.0))
    ]
    computing = [service.started(f"{how}-{name}-second") for name in ("during", "after")]
    workers = [worker.pid for worker in service.workers]
    if how == "silent":
        with server.stopped():
            time.sleep(OUTAGE_S)
    else:
        server.kill() if how == "killed" else server.stop()
        time.sleep(OUTAGE_S)
        assert alive(computing[1])
        server.start()
    finished = [service.finished(job, 60.0) for job in jobs]
    assert [(job.status, job.attempts) for job in finished] == [(JobStatus.SUCCESSFUL, 1)] * 2
    ends = [name for _, name, *_ in service.events("end") if name.startswith(how)]
    assert sorted(ends) == sorted(
        f"{how}-{name}-{k}" for name in ("during", "after") for k in ("first", "second", "third")
    )
    assert [worker.pid for worker in service.workers if worker.poll() is None] == workers


def test_a_worker_stops_in_time_while_the_database_is_away(tmp_path: Path, server: PostgresServer) -> None:
    with harness(tmp_path, database_url=server.new_database()) as service:
        worker = service.start_worker()
        job = service.submit([{"step": "nap", "seconds": 2.0, "name": "interrupted"}])
        computing = service.started("interrupted")
        server.stop()
        worker.terminate()
        took_s = wait_until(lambda: worker.poll() is not None, 20.0)
        server.start()
        assert not alive(computing)
        assert took_s < 8.0 * patience()
        service.start_worker()
        assert service.finished(job, 60.0).status is JobStatus.SUCCESSFUL
