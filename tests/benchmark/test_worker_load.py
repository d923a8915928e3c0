"""How many workers one queue feeds: the engine itself on PostgreSQL, with steps that sleep in place of computing.

uv run pytest -n0 -s -m benchmark tests/benchmark/test_worker_load.py    # TIELINE_QUEUE says which queue

Claiming, turns between projects, reports of progress, what comes next of a job, heartbeats and callbacks are the
service's own, in threads of a few processes with the connections of one worker each. Steps of a pair of scans sleep as
long as they took (`STEPS`), times a factor for each row: longer, as of scans of more points, where many workers share
this one machine, whose processors their side of the queue needs most; shorter, with jobs that come as much sooner,
where few workers would take long to show anything.
"""

import asyncio
import logging
import multiprocessing
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from multiprocessing.synchronize import Barrier, Event
from pathlib import Path

import numpy as np
import psutil
import psycopg
import pytest
import structlog

from service.adapters.database.callbacks import DatabaseCallbacks
from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import FRESH_FOR_WORKERS_S, connect
from service.adapters.database.turns import DatabaseTurns
from service.adapters.files.object_files import blob_store
from service.adapters.outgoing.callback_thread import CallbackThread
from service.adapters.outgoing.http_callbacks import HttpCallbacks
from service.engine import Engine, Tools
from service.ports import FreshJob, Job, JobStatus, Json, StepCall
from service.settings import Settings
from service.use_cases.callbacks.deliver_callbacks import CallbackDelivery
from service.use_cases.limits.quotas import admit_job, count_results
from service.worker import source_of
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]

STEPS: Mapping[str, tuple[float, int]] = {
    "features": (1.2, 3),
    "register-pair": (2.4, 5),
    "report-registration": (0.7, 2),
    "viewer-points": (1.25, 3),
}
"""Processor seconds that the steps of two scans of a million points took (the house of `tieline demo`), and how often
each reported its progress."""
STAGES = (("features", "features"), ("register-pair",), ("report-registration", "viewer-points", "viewer-points"))
SECONDS = sum(STEPS[name][0] for stage in STAGES for name in stage)
NUMBER = sum(map(len, STAGES))
AN_HOUR, BURST, PROJECTS, SMALL = 1000, 10_000, 5, 20
STEADY = ((1, 0.25, 60.0), (4, 0.25, 60.0), (16, 1.0, 90.0), (64, 1.0, 90.0), (128, 1.0, 90.0))
AWAITED = ((1, 0.25, 40.0), (4, 0.25, 40.0), (16, 1.0, 40.0), (64, 4.0, 40.0), (128, 4.0, 40.0))
"""Rows: workers, scale, seconds that are looked on."""
SETTLE_S = 10.0
FLEETS = 2
"""Processes that the workers are threads of."""
COLUMNS = (
    "workers",
    "a job computes",
    "jobs an hour",
    "of what they could",
    "a step waits, median, 95 of 100",
    "transactions a second",
    "connections",
    "server, of a core",
    "workers, of a core",
)


class Sleeper:
    """Sleep in place of computing, and say now and then how far it is."""

    def __init__(self, scale: float) -> None:
        self._scale = scale

    async def run(
        self,
        step: str,
        arguments: Json,  # noqa: ARG002
        *,
        timeout_s: float,  # noqa: ARG002
        on_progress: Callable[[float, str], None] | None = None,
    ) -> Json:
        seconds, reports = STEPS[step]
        for number in range(reports):
            await asyncio.sleep(seconds * self._scale / reports)
            if on_progress is not None:
                on_progress((number + 1) / reports, "sleeping")
        return {"slept_s": seconds}


class PairPlan:
    """The stages of a registration of two scans."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:  # noqa: ARG002
        if len(outputs) == len(STAGES):
            return None
        names = STAGES[len(outputs)]
        return [StepCall(name, {}, f"{name} {n}", STEPS[name][0]) for n, name in enumerate(names)]

    def total_weight(self, job: Json) -> float:  # noqa: ARG002
        return SECONDS


class Worker:
    """What `service.worker` puts together, but for the runner of steps."""

    def __init__(self, settings: Settings, slot: str, scale: float) -> None:
        self._database = connect(settings, fresh_s=FRESH_FOR_WORKERS_S)
        jobs, files = DatabaseJobStore(self._database), DatabaseFileStore(self._database)
        blobs, log = blob_store(settings), DatabaseJobLog(self._database)
        steps = DatabaseSteps(self._database)
        tools = Tools(
            settings=settings,
            jobs=jobs,
            steps=steps,
            source=source_of(settings, self._database, steps),
            log=log,
            files=files,
            executors=DatabaseExecutors(self._database),
            runner=Sleeper(scale),
            plans={"pair": PairPlan()},
            count_results=partial(count_results, jobs=jobs, files=files, blobs=blobs),
        )
        self._engine = Engine(tools, slot)
        callbacks = DatabaseCallbacks(self._database)
        holder, sender = self._engine.executor_id, HttpCallbacks(settings)
        self._callbacks = CallbackThread(CallbackDelivery(callbacks, jobs, blobs, log, sender, settings, holder))

    def start(self) -> None:
        self._engine.start()
        self._callbacks.start()

    def stop(self) -> None:
        self._callbacks.stop()
        self._engine.stop()
        self._database.dispose()


def fleet(settings: Settings, first: int, number: int, scale: float, ready: Barrier, stop: Event) -> None:
    """Be some of the workers, until told to stop."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.WARNING))
    workers = [Worker(settings, f"w{first + n}", scale) for n in range(number)]
    with ThreadPoolExecutor(32) as hands:
        list(hands.map(Worker.start, workers))
        ready.wait()
        stop.wait()
        list(hands.map(Worker.stop, workers))


@dataclass(frozen=True)
class Load:
    """One row: what comes in, and who works on it."""

    settings: Settings
    server: PostgresServer
    workers: int
    scale: float

    @contextmanager
    def working(self) -> Iterator[list[psutil.Process]]:
        """Run the workers; give their processes."""
        spawning = multiprocessing.get_context("spawn")
        shares = [len(range(n, self.workers, FLEETS)) for n in range(FLEETS)]
        shares = [share for share in shares if share]
        ready, stop = spawning.Barrier(len(shares) + 1), spawning.Event()
        fleets = [
            spawning.Process(target=fleet, args=(self.settings, 1000 * n, share, self.scale, ready, stop))
            for n, share in enumerate(shares)
        ]
        try:
            for each in fleets:
                each.start()
            ready.wait(300.0)
            yield [psutil.Process(each.pid) for each in fleets]
        finally:
            stop.set()
            for each in fleets:
                each.join(120.0)
                if each.is_alive():
                    each.kill()

    def measure(self, seconds: float, soon: Callable[[], object] = bool) -> "Window":
        """Look on for a while, in the beginning of which something happens."""
        with self.working() as processes:
            time.sleep(SETTLE_S)
            return self._look_on(seconds, processes, soon)

    def _look_on(self, seconds: float, processes: list[psutil.Process], soon: Callable[[], object]) -> "Window":
        url = self.settings.database_url
        first = (now_of(url), self.server.transactions(url), used_s(self.server_processes()), used_s(processes))
        most, until = 0, time.monotonic() + seconds
        soon()
        while time.monotonic() < until:
            most = max(most, self.server.connections())
            time.sleep(1.0)
        last = (now_of(url), self.server.transactions(url), used_s(self.server_processes()), used_s(processes))
        lasted, *sums = (b - a for a, b in zip(first, last, strict=True))
        return Window(self, first[0], last[0], most, *(each / lasted for each in sums))

    def server_processes(self) -> list[psutil.Process]:
        server = psutil.Process(self.server._process.pid)  # type: ignore[union-attr]
        return [server, *server.children()]


@dataclass(frozen=True)
class Window:
    """What was seen of a row."""

    load: Load
    begin: float
    end: float
    connections: int
    transactions: float
    server: float
    workers: float

    def ask(self, query: str) -> list[tuple[float, ...]]:
        with psycopg.connect(self.load.settings.database_url) as connection:
            return connection.execute(query, {"begin": self.begin, "end": self.end}).fetchall()

    @property
    def computed_s(self) -> float:
        """Unscaled seconds of the steps that ended."""
        query = "SELECT name, count(*) FROM job_steps WHERE ended BETWEEN %(begin)s AND %(end)s GROUP BY name"
        return sum(STEPS[str(name)][0] * number for name, number in self.ask(query))

    @property
    def busy(self) -> float:
        """Share of their time that workers sleep for steps."""
        return self.computed_s * self.load.scale / (self.end - self.begin) / self.load.workers

    def waits_s(self) -> np.ndarray:
        """Give how long steps have waited that began."""
        query = "SELECT begun - waiting_since FROM job_steps WHERE begun BETWEEN %(begin)s AND %(end)s"
        return np.array([row[0] for row in self.ask(query)])

    def first_waits_s(self, owner: str) -> np.ndarray:
        """Give how long jobs of a project that were sent have waited for their first step, ascending."""
        query = f"""SELECT min(s.begun) - extract(epoch FROM j.created) FROM job_steps s JOIN jobs j ON j.id = s.job_id
            WHERE j.owner = '{owner}' AND s.begun <= %(end)s AND %(begin)s > 0 GROUP BY j.id, j.created"""  # noqa: S608
        return np.sort([float(row[0]) for row in self.ask(query)])

    def shares(self) -> dict[str, int]:
        """Give the number of steps that began, by project."""
        query = """SELECT j.owner, count(*) FROM job_steps s JOIN jobs j ON j.id = s.job_id
            WHERE s.begun BETWEEN %(begin)s AND %(end)s GROUP BY j.owner"""
        return {str(owner): int(number) for owner, number in self.ask(query)}

    def row(self) -> str:
        waits = self.waits_s()
        middle, late = (f"{np.quantile(waits, q):.2f} s" for q in (0.5, 0.95)) if waits.size else ("–", "–")
        cells = (
            self.load.workers,
            f"{SECONDS * self.load.scale:g} s",
            f"{3600.0 * self.computed_s / SECONDS / (self.end - self.begin):.0f}",
            f"{100.0 * self.busy:.0f} %",
            f"{middle}, {late}",
            f"{self.transactions:.0f}",
            self.connections,
            f"{self.server:.2f}",
            f"{self.workers:.2f}",
        )
        return f"| {' | '.join(map(str, cells))} |"


def now_of(url: str) -> float:
    with psycopg.connect(url) as connection:
        return float(connection.execute("SELECT extract(epoch FROM clock_timestamp())").fetchone()[0])  # type: ignore[index]


def used_s(processes: list[psutil.Process]) -> float:
    found = 0.0
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            found += sum(process.cpu_times()[:4])
    return found


class Senders:
    """Send jobs, as requests do."""

    def __init__(self, settings: Settings) -> None:
        self._engine = connect(settings)
        self._jobs = DatabaseJobStore(self._engine)
        self._admit = admit_job(settings)

    def send(self, owner: str) -> None:
        job = Job(uuid.uuid4().hex, "pair", {}, JobStatus.ACCEPTED, datetime.now(UTC), owner=owner)
        self._jobs.of(owner).create_and_enqueue(job, self._admit, total_weight=SECONDS)

    def send_some(self, owner: str, number: int) -> None:
        for _ in range(number):
            self.send(owner)

    def close(self) -> None:
        self._engine.dispose()


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    """Run a server with room for all workers."""
    with postgres_server(max_connections="700") as server:
        yield server


def settings_of(url: str, folder: Path, **values: int) -> Settings:
    return Settings(data_dir=folder, database_url=url, slots=1, max_queued_jobs=2 * BURST, **values)


def copy_of(server: PostgresServer, url: str) -> str:
    """Copy a database to which nobody is connected; give the address of the copy."""
    name = f"copy_{uuid.uuid4().hex[:8]}"
    with psycopg.connect(server.url("postgres"), autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name} TEMPLATE {url.rpartition('/')[2]}")
    return server.url(name)


@pytest.fixture(scope="module")
def burst(server: PostgresServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Send a burst of jobs of some projects; give the address of the database."""
    url = server.new_database()
    settings = settings_of(url, tmp_path_factory.mktemp("burst"))
    migrate(settings)
    senders, began = Senders(settings), time.monotonic()
    with ThreadPoolExecutor(4) as hands:
        list(hands.map(senders.send, (f"project-{n % PROJECTS}" for n in range(BURST))))
    senders.close()
    print(f"\n{BURST} jobs of {PROJECTS} projects are accepted in {time.monotonic() - began:.0f} s.")
    return url


def print_head() -> None:
    print(f"\n| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")


def test_workers_beside_a_thousand_jobs_an_hour(server: PostgresServer, tmp_path: Path) -> None:
    print(f"\n{AN_HOUR} jobs of {NUMBER} steps, {SECONDS:g} s of computing, come an hour: work for {demand():.1f}.")
    print("Where a job computes a quarter as long, four times as many come.")
    print_head()
    for workers, scale, seconds in STEADY:
        settings = settings_of(server.new_database(), tmp_path / str(workers))
        migrate(settings)
        senders, ended = Senders(settings), threading.Event()
        sending = threading.Thread(target=send_steadily, args=(senders, 3600.0 / AN_HOUR * scale, ended))
        sending.start()
        try:
            window = Load(settings, server, workers, scale).measure(seconds)
        finally:
            ended.set()
            sending.join()
            senders.close()
        print(window.row())
        if workers > 2.0 * demand():
            assert np.quantile(window.waits_s(), 0.95) < 1.0


def demand() -> float:
    return AN_HOUR * SECONDS / 3600.0


def send_steadily(senders: Senders, gap_s: float, ended: threading.Event) -> None:
    """Send jobs of some projects at random moments."""
    rng, number = np.random.default_rng(0), 0
    while not ended.wait(rng.exponential(gap_s)):
        senders.send(f"project-{number % PROJECTS}")
        number += 1


def test_workers_that_a_burst_awaits(server: PostgresServer, burst: str, tmp_path: Path) -> None:
    print_head()
    notes = []
    for workers, scale, seconds in AWAITED:
        settings = settings_of(copy_of(server, burst), tmp_path / str(workers))
        senders = Senders(settings)
        window = Load(settings, server, workers, scale).measure(seconds, partial(senders.send_some, "small", SMALL))
        senders.close()
        print(window.row())
        shares, waits = window.shares(), window.first_waits_s("small")
        of_burst = [number for owner, number in shares.items() if owner != "small"]
        notes.append(
            f"{workers} workers: of each project of the burst {min(of_burst)} to {max(of_burst)} steps begin; of "
            f"{SMALL} jobs that another one sends then the first begins after {waits[0]:.2f} s, {waits.size} of them "
            f"within {waits[-1]:.1f} s"
        )
        assert max(of_burst) <= 1.25 * min(of_burst) + 2
        assert window.busy > 0.75
    print("\n".join(notes))


def test_what_one_project_gets_of_many_workers(server: PostgresServer, burst: str, tmp_path: Path) -> None:
    print_head()
    rows = []
    for most in (64, 256):
        settings = settings_of(copy_of(server, burst), tmp_path / str(most), max_running_jobs=most)
        with psycopg.connect(settings.database_url) as connection:
            connection.execute("UPDATE jobs SET owner = 'one'")
        window = Load(settings, server, 128, 4.0).measure(30.0)
        print(f"{window.row()} TIELINE_MAX_RUNNING_JOBS={most}")
        rows.append(window.busy)
    assert rows[1] > 0.75


def test_how_fast_turns_are_given(server: PostgresServer, burst: str, tmp_path: Path) -> None:
    """One after the other, as they are: what one worker alone is given is what all together are."""
    print("\n| jobs that wait | ms a turn | turns a second | workers that it feeds |\n|---|---|---|---|")
    for waiting in (100, BURST):
        settings = settings_of(copy_of(server, burst), tmp_path / str(waiting))
        with psycopg.connect(settings.database_url) as connection:
            connection.execute(
                "DELETE FROM jobs WHERE id NOT IN (SELECT id FROM jobs ORDER BY created LIMIT %s)", [waiting]
            )
        engine = connect(settings, fresh_s=FRESH_FOR_WORKERS_S)
        steps, turns, taken = DatabaseSteps(engine), DatabaseTurns(engine, settings.max_running_jobs), []
        DatabaseExecutors(engine).register("w")
        for _ in range(300):
            began = time.monotonic()
            turn = turns.take_turn("w", datetime.now(UTC), alone=True)
            taken.append(time.monotonic() - began)
            if isinstance(turn, FreshJob):
                steps.plan_stage(turn.id, 0, PairPlan().next_stage({}, []) or (), SECONDS)
        engine.dispose()
        # a job that is to be begun is one turn more
        each = float(np.median(taken)) * (NUMBER + 1) / NUMBER
        print(f"| {waiting} | {1e3 * each:.1f} | {1.0 / each:.0f} | {SECONDS / NUMBER / each:.0f} |")
        assert SECONDS / NUMBER / each > 128
