"""A service without its web part: a database, workers as processes, and a look at both."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

import psutil
import sqlalchemy as sa

from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.jobs import DatabaseJobStore
from service.adapters.database.queue import DatabaseQueue
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import connect
from service.launcher import prepare
from service.ports import Job, JobStatus
from service.settings import Settings
from tests.measures.patience import patience

HERE = Path(__file__).parent
STEPS_AND_PLANS = ("--steps", "engine_steps:STEPS", "--plans", "engine_steps:PLANS")


def wait_until(condition: Callable[[], bool], within_s: float = 30.0, every_s: float = 0.02) -> float:
    """Wait; give the seconds it took."""
    begin = time.monotonic()
    while not condition():
        passed = time.monotonic() - begin
        limit_s = within_s * patience()
        assert passed < limit_s, f"not within {limit_s:.0f} s"
        time.sleep(every_s)
    return time.monotonic() - begin


@dataclass
class Harness:
    settings: Settings
    engine: sa.Engine
    queue: DatabaseQueue
    jobs: DatabaseJobStore
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    @property
    def trace(self) -> Path:
        return self.settings.data_dir / "trace"

    def environment(self) -> dict[str, str]:
        return {
            **os.environ,
            "PYTHONPATH": str(HERE),
            "TIELINE_CONFINE_CHILDREN": "false",  # the steps write down what they do, and kill
            "TIELINE_DATA_DIR": str(self.settings.data_dir),
            "TIELINE_DATABASE_URL": self.settings.database_url,
            "TIELINE_QUEUE": self.settings.queue,
            "TIELINE_SLOTS": str(self.settings.slots),
            "TIELINE_STEP_MEMORY_BYTES": str(self.settings.step_memory_bytes),
            "TIELINE_MAX_RUNNING_JOBS": str(self.settings.max_running_jobs),
            "TIELINE_MAX_ATTEMPTS": str(self.settings.max_attempts),
            "TIELINE_STEP_TIMEOUT_S": str(self.settings.step_timeout_s),
        }

    def start_worker(self, slot: str = "0") -> subprocess.Popen[bytes]:
        log = (self.settings.data_dir / "worker.log").open("ab")
        worker = subprocess.Popen(
            [sys.executable, "-m", "service.worker", "--slot", slot, *STEPS_AND_PLANS],
            env=self.environment(),
            stderr=log,
            start_new_session=True,
        )
        log.close()
        self.workers.append(worker)
        return worker

    def start_launched_worker(self) -> subprocess.Popen[bytes]:
        """Start a worker and the process that keeps it running, with which it dies."""
        program = (
            "import os, subprocess, sys; "
            "subprocess.run([sys.executable, '-m', 'service.worker', *sys.argv[1:], '--parent', str(os.getpid())])"
        )
        with (self.settings.data_dir / "worker.log").open("ab") as log:
            launcher = subprocess.Popen(
                [sys.executable, "-c", program, *STEPS_AND_PLANS],
                env=self.environment(),
                stderr=log,
                start_new_session=True,
            )
        self.workers.append(launcher)
        return launcher

    def submit(self, *stages: list[dict[str, object]], **of_job: Any) -> str:
        named = [[{"trace": str(self.trace), **step} for step in stage] for stage in stages]
        job = Job(str(uuid4()), "listed", {"stages": named}, JobStatus.ACCEPTED, datetime.now(UTC), **of_job)
        self.jobs.create_and_enqueue(job, total_weight=float(sum(map(len, stages))))
        return job.id

    def job(self, job_id: str) -> Job:
        job = self.jobs.get(job_id)
        assert job is not None
        return job

    def finished(self, job_id: str, within_s: float = 30.0) -> Job:
        wait_until(lambda: self.job(job_id).status.finished, within_s)
        return self.job(job_id)

    def events(self, event: str, name: str | None = None) -> list[list[str]]:
        lines = self.trace.read_text().splitlines() if self.trace.exists() else []
        found = [line.split() for line in lines]
        return [words for words in found if words[0] == event and name in {None, words[1]}]

    def started(self, name: str, times: int = 1, within_s: float = 30.0) -> int:
        """Wait until a step has started so often; give the process id of the last start."""
        wait_until(lambda: len(self.events("start", name)) >= times, within_s)
        return int(self.events("start", name)[-1][2])

    def scratch_left(self) -> list[str]:
        return [path.name for path in (self.settings.data_dir / "scratch").iterdir()]

    def kill_all(self) -> None:
        for worker in self.workers:
            if worker.poll() is None:
                worker.kill()
            worker.wait()
        self.workers.clear()


@contextmanager
def harness(directory: Path, **values: object) -> Iterator[Harness]:
    settings = Settings(data_dir=directory, **values)  # type: ignore[arg-type]
    prepare(settings)
    engine = connect(settings)
    queue = DatabaseQueue(DatabaseExecutors(engine), DatabaseSteps(engine))
    made = Harness(settings, engine, queue, DatabaseJobStore(engine))
    try:
        yield made
    finally:
        for worker in made.workers:
            worker.send_signal(signal.SIGKILL)
            worker.wait()
        engine.dispose()


def alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
