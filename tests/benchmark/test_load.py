"""The service under load: fifty clients asking, eight uploading, two workers computing; 2000 jobs waiting.

    uv run pytest -n0 -s -m benchmark tests/benchmark/test_load.py

Takes five minutes, three of them for the 2000 jobs, and prints one table. Clients ask for the status of a job every
`EVERY_S`, each over one connection (500 requests a second); uploaders send 16 MB again and again as raw body, form and
by tus, together as fast as a line of one gigabit a second. The computations are registrations of two virtual stations,
put on the queue so that both workers always have one. All run on the machine of the service, so that the clients' own
processor time counts too. Times are from when a request was sent; `due p99` is from when it was due, so that requests
that wait for the answer before them are not forgotten. TIELINE_LOAD_S is the length of one phase, TIELINE_LOAD_API the
number of API processes (2; the service's own default is 1), TIELINE_LOAD_JOBS that of jobs.
"""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest

from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from tests.e2e.files.broken_uploads import write_scan
from tests.e2e.running.running_service import RunningService, running_service, wait_until
from tests.e2e.running.virtual_scans import write_scans

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

PHASE_S = float(os.environ.get("TIELINE_LOAD_S", "20"))
POLLERS, EVERY_S = 50, float(os.environ.get("TIELINE_LOAD_EVERY_S", "0.1"))
UPLOADS = ("raw", "multipart", "tus", "raw", "multipart", "tus", "raw", "tus")
UPLOAD_BYTES, LINE_BYTES_PER_S = 16 << 20, 125e6
"""Of each file, and of all uploads together."""
WANTED_P99_S = 0.050
API_PROCESSES = os.environ.get("TIELINE_LOAD_API", "2")
"""As `docker/compose.yaml` has."""
ECHOES = int(os.environ.get("TIELINE_LOAD_JOBS", "2000"))
HEAD = (
    f"{'':26} {'requests/s':>10} {'p50':>6} {'p95':>6} {'p99':>6} {'max ms':>6} {'due p99':>7} {'errors':>6}"
    f" {'API ms*':>7} {'API MB':>6} {'computing':>9} {'clients':>7} {'uploads':>7} {'MB/s':>5}"
    "   (* of processor for each request; computing and clients: processors)"
)
ROOT = Path(__file__).parents[2]
SCANNER = VirtualScanner(rows=300, columns=720)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("service"), SLOTS="2", API_PROCESSES=API_PROCESSES) as running:
        yield running


@pytest.fixture(scope="module")
def stations(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    scene = SCENES["house"]()
    scans = list(simulate_stations(scene, scene.stations[:2], SCANNER, np.random.default_rng(1)))
    return [service.upload(path)["id"] for path in write_scans(tmp_path_factory.mktemp("house"), scans)]


@pytest.fixture(scope="module")
def table() -> Iterator[list[str]]:
    """Lines to print in the end."""
    lines = [HEAD]
    yield lines
    print("\n\n" + "\n".join(lines))


def registration(service: RunningService, stations: Sequence[str]) -> str:
    named = [{"name": f"S{i}", "scan": {"file": file}} for i, file in enumerate(stations)]
    return service.execute("register", {"stations": named})


@contextmanager
def computing(service: RunningService, stations: Sequence[str]) -> Iterator[list[str]]:
    """Keep both workers busy; give the jobs that were begun."""
    jobs, stop = [registration(service, stations) for _ in range(4)], threading.Event()

    def feed() -> None:
        with httpx.Client(base_url=service.url, timeout=30.0) as http:
            while not stop.wait(0.5):
                waiting = http.get("/jobs", params={"status": "accepted", "limit": 1}).json()["numberMatched"]
                if waiting < 2:
                    jobs.append(registration(service, stations))

    feeder = threading.Thread(target=feed)
    feeder.start()
    wait_until(lambda: len(service.computations()) > 1)
    try:
        yield jobs
    finally:
        stop.set()
        feeder.join()
        for job in jobs:
            if service.job(job)["status"] in {"accepted", "running"}:
                service.http.delete(f"/jobs/{job}")


def clients(service: RunningService, **order: Any) -> "subprocess.Popen[str]":
    """Start a process of clients."""
    started = subprocess.Popen(
        [sys.executable, "-m", "tests.benchmark.load_clients", service.url],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert started.stdin is not None
    started.stdin.write(json.dumps({"pollers": 0, "every_s": EVERY_S, "uploads": [], "jobs": [], **order}))
    started.stdin.close()
    return started


def heard(process: "subprocess.Popen[str]") -> Any:
    assert process.stdout is not None
    with process.stdout:
        said = process.stdout.read()
    assert process.wait() == 0
    return json.loads(said)


def processor_s(processes: Sequence[psutil.Process]) -> float:
    """Give the processor time of processes and of their children that have ended."""
    total = 0.0
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            times = process.cpu_times()
            total += times.user + times.system + times.children_user + times.children_system
    return total


def computing_processes(service: RunningService) -> Sequence[psutil.Process]:
    """Processes that compute for the workers, and those that they are copies of."""
    return [*service.nurseries_of_workers(), *service.computations()]


def loaded(service: RunningService, table: list[str], what: str, uploads: Sequence[tuple[str, Path]] = ()) -> None:
    """Let the clients loose and add a row; they must meet no error, and nobody may wait."""
    jobs = [job["jobID"] for job in service.http.get("/jobs", params={"limit": 50}).json()["jobs"]]
    apis = service.apis()
    before = processor_s(apis), processor_s(computing_processes(service))
    begin = time.perf_counter()
    rate = LINE_BYTES_PER_S / max(1, len(uploads))
    named = [(manner, str(path)) for manner, path in uploads]
    uploaders = clients(service, uploads=named, bytes_per_s=rate, seconds=PHASE_S) if uploads else None
    seen = heard(clients(service, jobs=jobs, pollers=POLLERS, seconds=PHASE_S))
    sent = {"uploads_s": [], "upload_errors": {}, "processor_s": 0.0} if uploaders is None else heard(uploaders)
    took_s = time.perf_counter() - begin
    api_s, computing_s = processor_s(apis) - before[0], processor_s(computing_processes(service)) - before[1]
    memory = max(api.memory_info().rss for api in apis)
    latencies_ms = 1e3 * np.array(seen["since_sent_s"])
    p50, p95, p99 = np.percentile(latencies_ms, [50, 95, 99])
    due_p99 = np.percentile(1e3 * np.array(seen["since_due_s"]), 99)
    errors = sum(seen["errors"].values()) + sum(sent["upload_errors"].values())
    uploads = len(sent["uploads_s"])
    clients_s = seen["processor_s"] + sent["processor_s"]
    table.append(
        f"{what:26} {len(latencies_ms) / PHASE_S:10.0f} {p50:6.1f} {p95:6.1f} {p99:6.1f} {latencies_ms.max():6.0f}"
        f" {due_p99:7.1f} {errors:6} {1e3 * api_s / len(latencies_ms):7.2f} {memory / 1e6:6.0f}"
        f" {computing_s / took_s:9.2f} {clients_s / took_s:7.2f} {uploads:7}"
        f" {uploads * UPLOAD_BYTES / took_s / 1e6:5.0f}"
    )
    print(f"\n{HEAD}\n{table[-1]}")
    assert seen["errors"] == {}
    assert sent["upload_errors"] == {}
    assert max(p99, due_p99) <= 1e3 * WANTED_P99_S


def some_jobs(service: RunningService) -> None:
    for number in range(50):
        service.execute("echo", {"stringInput": str(number)}, Prefer="respond-async")
    wait_until(lambda: not unfinished(service), 120.0)


def unfinished(service: RunningService) -> int:
    query = {"status": "accepted,running", "limit": 1}
    return int(service.http.get("/jobs", params=query).json()["numberMatched"])


def test_status_answers_at_once_while_nothing_else_happens(service: RunningService, table: list[str]) -> None:
    some_jobs(service)
    loaded(service, table, "50 clients ask")


def test_status_answers_at_once_while_two_workers_compute(
    service: RunningService, stations: list[str], table: list[str]
) -> None:
    with computing(service, stations):
        loaded(service, table, ".. while 2 workers compute")


def test_status_answers_at_once_while_eight_upload_too(
    service: RunningService, stations: list[str], table: list[str], tmp_path: Path
) -> None:
    files = [write_scan(tmp_path / f"large-{i}.las", UPLOAD_BYTES + i) for i in range(len(UPLOADS))]
    with computing(service, stations):
        loaded(service, table, ".. and 8 clients upload", list(zip(UPLOADS, files, strict=True)))


def timed(text: Any) -> float:
    return datetime.fromisoformat(text).timestamp()


def test_the_queue_adds_less_than_a_second_to_a_job(
    service: RunningService, stations: list[str], table: list[str]
) -> None:
    wait_until(lambda: not unfinished(service), 60.0)
    waits, totals = [], []
    for number in range(12):
        job = service.finished(service.execute("echo", {"stringInput": str(number)}, Prefer="respond-async"))
        waits.append(timed(job["started"]) - timed(job["created"]))
        totals.append(timed(job["finished"]) - timed(job["created"]))
    table.append(
        f"echo on an idle service: begins after {np.median(waits):.2f} s (most {max(waits):.2f}), "
        f"has ended after {np.median(totals):.2f} s (most {max(totals):.2f})"
    )
    print(f"\n{table[-1]}")
    registering = [idle_seconds(service, registration(service, stations)) for _ in range(4)]
    whole, idle = (np.median([each[i] for each in registering]) for i in range(2))
    table.append(f"registration of two stations: {whole:.2f} s, of which no step was running for {idle:.2f} s")
    print(table[-1])
    assert max(totals) < 1.5
    assert np.median(totals) < 1.0
    assert idle < 1.0


def idle_seconds(service: RunningService, job_id: str) -> tuple[float, float]:
    """Give how long a job took from submission to end, and for how much of that none of its steps was running."""
    job = service.finished(job_id)
    assert job["status"] == "successful"
    running, busy, begun = 0, 0.0, 0.0
    for line in service.http.get(f"/jobs/{job_id}/log").text.splitlines():
        when = timed(line.split()[0])
        if line.endswith(": begun"):
            begun = when if running == 0 else begun
            running += 1
        elif ": done in " in line:
            running -= 1
            busy += when - begun if running == 0 else 0.0
    assert running == 0
    whole = timed(job["finished"]) - timed(job["created"])
    return whole, whole - busy


def test_two_thousand_jobs_are_done_once_each(service: RunningService, table: list[str]) -> None:
    wait_until(lambda: not unfinished(service), 60.0)
    inputs = {"inputs": {"stringInput": "x"}}
    begin = time.perf_counter()
    jobs = []
    for _ in range(ECHOES):
        answer = service.post("/processes/echo/execution", json=inputs, headers={"Prefer": "respond-async"})
        assert answer.status_code == 201, answer.text
        jobs.append(answer.json()["jobID"])
    submitted_s = time.perf_counter() - begin
    left = unfinished(service)
    drained_s = wait_until(lambda: not unfinished(service), 600.0, every_s=0.5)
    listed = [job for offset in range(0, ECHOES, 1000) for job in page(service, offset)]
    ended = {job["jobID"]: job for job in listed}
    table.append(
        f"{ECHOES} jobs: taken in {submitted_s:.1f} s ({ECHOES / submitted_s:.0f}/s) while {ECHOES - left} were done, "
        f"the other {left} done in {drained_s:.1f} s ({left / drained_s:.1f}/s)"
    )
    print(f"\n{table[-1]}")
    assert {ended[job]["status"] for job in jobs} == {"successful"}
    assert {ended[job]["attempts"] for job in jobs} == {1}
    logs = [service.http.get(f"/jobs/{job}/log").text for job in jobs[::20]]
    assert {log.count(": begun") for log in logs} == {1}


def page(service: RunningService, offset: int) -> Any:
    return service.http.get("/jobs", params={"limit": 1000, "offset": offset}).json()["jobs"]
