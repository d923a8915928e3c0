"""A whole service whose processes are killed, and a look at whether its jobs end as they should."""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import numpy as np
import psutil
import sqlalchemy as sa

from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.tables import connect, job_steps
from service.settings import Settings
from tests.e2e.running.running_service import Document, RunningService, alive, wait_until
from tests.e2e.running.virtual_scans import first_from_second
from tests.measures.patience import patience
from tests.servers.postgres_server import PostgresServer, postgres_server

STEPS = {"features of S1": "0:0", "features of S2": "0:1", "registering S2 to S1": "1:0", "writing the report": "2:0"}
"""What a job of two stations does, and the name of the step within the job."""
SETTINGS = {"SLOTS": "1", "MAX_ATTEMPTS": "1000"}
ANSWER_WITHIN_S = 300.0
"""A killed API process is there again in some seconds of processor time, which may be minutes on a busy machine."""
FINISHED = {"successful", "failed", "dismissed"}


@dataclass
class AttackedService:
    """A service, its clients, and its database server if it has one: then there are two workers."""

    running: RunningService
    server: PostgresServer | None
    stations: Sequence[Document] = ()
    noise_m: float = 0.002
    _database: sa.Engine = field(init=False)

    def __post_init__(self) -> None:
        url = self.running.settings["DATABASE_URL"]
        self._database = connect(Settings(data_dir=self.running.data, database_url=url))

    # clients, who ask again when the connection breaks

    def ask(self, method: str, path: str, **what: Any) -> httpx.Response:
        deadline = time.monotonic() + ANSWER_WITHIN_S * patience()
        while True:
            with suppress(httpx.TransportError, RuntimeError):
                answer = httpx.request(method, self.running.url + path, timeout=30.0 * patience(), **what)
                if answer.status_code != httpx.codes.SERVICE_UNAVAILABLE:
                    return answer
            assert time.monotonic() < deadline, f"{method} {path}: no answer\n{self.running.log[-3000:]}"
            time.sleep(0.1)

    def upload(self, path: Path) -> None:
        file = self.running.upload(path)["id"]
        self.stations = [{"name": f"S{k + 1}", "scan": {"file": file, "index": k}} for k in range(2)]

    def register(self) -> str:
        """Begin a registration in which every step has something to do: no other job has the same features."""
        self.noise_m += 1e-6
        stations = [{**station, "point_std_m": self.noise_m} for station in self.stations]
        answer = self.ask(
            "POST",
            "/processes/register/execution",
            json={"inputs": {"stations": stations}},
            headers={"Idempotency-Key": str(uuid4())},
        )
        assert answer.status_code == 201, answer.text
        return str(answer.json()["jobID"])

    def job(self, job_id: str) -> Document:
        answer = self.ask("GET", f"/jobs/{job_id}")
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def register_up_to(self, step: str) -> str:
        """Begin registrations until one is seen to compute a step, which on a busy machine may pass between two looks.

        Those that went past it must end right by themselves.
        """
        while True:
            job_id = self.register()
            deadline = time.monotonic() + 120.0 * patience()
            while (job := self.job(job_id))["status"] not in FINISHED:
                if str(job["message"]).startswith(step) and self.running.computations() != []:
                    return job_id
                assert time.monotonic() < deadline, f"'{step}' is not reached: {json.dumps(job)}"
                time.sleep(0.02)
            assert self.faults_of(job_id) == []

    # attacks

    def attack(self, victim: str) -> None:
        """Do something to a victim that it, or the service, must survive; what needs the operator is mended at once."""
        getattr(self, f"_kill_{victim}")()

    def _kill_computation(self) -> None:
        for process in self.running.computations()[:1]:
            _end(process)

    def _kill_worker(self) -> None:
        _end(self._busy_worker())

    def _kill_api(self) -> None:
        _end(self.running.apis()[0])

    def _kill_everything(self) -> None:
        self.running.kill_everything()
        self.running.start()

    def _kill_in_order(self) -> None:
        """Stop the service as its operator does, and start it again."""
        family = self.running.processes()
        assert self.running.stop() == 0
        wait_until(lambda: not any(alive(process) for process in family), 1.0)
        self.running.start()

    def _kill_life_of_worker(self) -> None:
        """Stop a worker until others, if there are any, take it for dead, and let it go on then."""
        worker = self._busy_worker()
        worker.suspend()
        time.sleep(9.0)
        with suppress(psutil.NoSuchProcess):
            worker.resume()

    def _kill_breath_of_worker(self) -> None:
        """Stop a worker for a moment: nobody is to take notice."""
        worker = self._busy_worker()
        worker.suspend()
        time.sleep(1.0)
        worker.resume()

    def _kill_database(self) -> None:
        assert self.server is not None
        self.server.kill()
        time.sleep(0.5)
        self.server.start()

    def _busy_worker(self) -> psutil.Process:
        """Give the worker whose nursery computes; any where none does."""
        with suppress(psutil.NoSuchProcess, IndexError, AttributeError):
            nursery = self.running.computations()[0].parent()
            return nursery.parent()  # type: ignore[union-attr, return-value]
        wait_until(lambda: self.running.workers() != [])
        return self.running.workers()[-1]

    # judgement

    def faults_of(self, job_id: str) -> Sequence[str]:
        """Wait for the end of a job; say what is not as it should be."""
        wait_until(lambda: self.job(job_id)["status"] in FINISHED, 180.0, every_s=0.1)
        job = self.job(job_id)
        if job["status"] != "successful":
            return [f"{job_id}: {json.dumps(job)}"]
        answer = self.ask("GET", f"/jobs/{job_id}/results")
        shift = np.array(answer.json()["stations"][1]["world_from_scan"]["matrix"])[:3, 3]
        found = [] if np.allclose(shift, first_from_second("house").translation, atol=0.005) else ["a wrong pose"]
        recorded = self._recorded(job_id)
        begun = [line for line in DatabaseJobLog(self._database).read(job_id, 10_000) if line.text.endswith(": begun")]
        for step, name in STEPS.items():
            times = [1e3 * line.time.timestamp() for line in begun if line.text == f"{step}: begun"]
            if not times:
                found.append(f"'{step}' was never begun")
            elif len(recorded.get(name, ())) != 1:
                found.append(f"'{step}' was finished {len(recorded.get(name, ()))} times")
            elif max(times) > recorded[name][0]:
                found.append(f"'{step}' was begun again after it had finished")
        return [f"{job_id}: {fault}" for fault in found]

    def _recorded(self, job_id: str) -> Mapping[str, Sequence[float]]:
        """Give the times (ms) at which the end of each step of a job was recorded."""
        query = sa.select(job_steps.c.stage, job_steps.c.position, job_steps.c.ended).where(
            job_steps.c.job_id == job_id, job_steps.c.state == "done"
        )
        found: dict[str, list[float]] = {}
        with self._database.connect() as connection:
            for stage, position, ended in connection.execute(query):
                found.setdefault(f"{stage}:{position}", []).append(1e3 * ended)
        return found

    def attempts_of(self, job_id: str) -> int:
        return int(self.job(job_id)["attempts"])

    def strays(self, jobs: Sequence[str]) -> Sequence[str]:
        """Remove all jobs and files; give what is still stored, and processes that do not belong to the service."""
        wait_until(lambda: self.running.computations() == [], 20.0)
        for job_id in jobs:
            self.ask("DELETE", f"/jobs/{job_id}")
        for file in {str(station["scan"]["file"]) for station in self.stations}:
            self.ask("DELETE", f"/files/{file}")
        with suppress(AssertionError):  # what is on its way out may take a moment
            wait_until(lambda: self.running.stored() == set(), 5.0)
        family = {process.pid for process in self.running.processes()}
        others = [process for process in _processes_of(self.running.home) if process.pid not in family]
        return [*sorted(self.running.stored()), *(f"process {' '.join(_command(each))}" for each in others)]

    def close(self) -> None:
        self._database.dispose()


VICTIMS = ("computation", "worker", "api", "everything", "in_order", "life_of_worker", "breath_of_worker")


def victims_beside(kind: str) -> Sequence[str]:
    """Name what may die where a kind of database is used."""
    return [*VICTIMS, *(["database"] if kind == "postgresql" else [])]


def _end(process: psutil.Process) -> None:
    with suppress(psutil.NoSuchProcess):
        os.kill(process.pid, signal.SIGKILL)


def _processes_of(home: Path) -> Sequence[psutil.Process]:
    """Find all processes of a service, whoever their parents are, by the temporary directory in their environment."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.NoSuchProcess, psutil.AccessDenied, psutil.ZombieProcess):
            if process.environ().get("TMPDIR") == str(home / "tmp"):
                found.append(process)
    return found


def _command(process: psutil.Process) -> Sequence[str]:
    with suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
        return process.cmdline()
    return ["gone"]


def left_after(home: Path, is_there: Callable[[psutil.Process], bool] = alive) -> Sequence[str]:
    """Name the processes of a service that is stopped."""
    return [" ".join(_command(process)) for process in _processes_of(home) if is_there(process)]


@contextmanager
def attacked_service(home: Path, kind: str, scans: Path) -> Iterator[AttackedService]:
    """Run a service on a kind of database, and stop it in the end; nothing of it may be left then."""
    if kind == "sqlite":
        with _attacked(home, scans, None) as service:
            yield service
    else:
        with postgres_server() as server, _attacked(home, scans, server) as service:
            yield service


@contextmanager
def _attacked(home: Path, scans: Path, server: PostgresServer | None) -> Iterator[AttackedService]:
    url = "" if server is None else server.new_database()
    running = RunningService(home, {**SETTINGS, "DATABASE_URL": url, "WORKERS": "1" if server is None else "2"})
    running.start()
    service = AttackedService(running, server)
    try:
        service.upload(scans)
        yield service
    finally:
        service.close()
        running.stop()
    assert left_after(home) == []
