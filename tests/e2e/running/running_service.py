"""The whole service as a user runs it (`tieline serve`), with a look at its processes and its data directory."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import psutil

from service.adapters.processes.nursery import SCOUT
from tests.measures.patience import patience

Document = dict[str, Any]
OF_THE_SERVICE = (
    "secrets.key",
    "tieline.sqlite",
    "tieline.sqlite-wal",
    "tieline.sqlite-shm",
    "service.lock",
    "worker.lock",
)
"""What lies in a data directory besides what clients stored."""


def wait_until(condition: Callable[[], bool], within_s: float = 60.0, every_s: float = 0.05) -> float:
    """Wait; give the seconds it took."""
    begin = time.monotonic()
    while not condition():
        passed = time.monotonic() - begin
        limit_s = within_s * patience()
        assert passed < limit_s, f"not within {limit_s:.0f} s"
        time.sleep(every_s)
    return time.monotonic() - begin


def alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@dataclass
class RunningService:
    """A service on a free port, its data below `home`."""

    home: Path
    settings: Mapping[str, str] = field(default_factory=lambda: {"SLOTS": "2"})
    """Environment variables without their prefix."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Further environment variables."""
    program: Sequence[str] = ("service", "serve", "--port", "0")
    """Module that runs it, and its arguments."""
    folder: Path | None = None
    """Where it is called; None: here."""
    url: str = ""
    http: httpx.Client = field(init=False)
    _launcher: subprocess.Popen[bytes] = field(init=False)

    @property
    def data(self) -> Path:
        return self.home / "data"

    @property
    def temporary(self) -> Path:
        """What the service's processes take for the system's temporary directory."""
        return self.home / "tmp"

    @property
    def log(self) -> str:
        return (self.home / "service.log").read_text(errors="replace")

    def start(self) -> None:
        self.temporary.mkdir(parents=True, exist_ok=True)
        environment = {name: value for name, value in os.environ.items() if not name.startswith("TIELINE_")}
        with (self.home / "service.log").open("ab") as log:
            self._launcher = subprocess.Popen(
                [sys.executable, "-m", *self.program, "--data-dir", str(self.data)],
                env={
                    **environment,
                    **self.environment,
                    "TMPDIR": str(self.temporary),
                    **{f"TIELINE_{name}": value for name, value in self.settings.items()},
                },
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
                cwd=self.folder,
            )
        assert self._launcher.stdout is not None
        with self._launcher.stdout:
            words = self._launcher.stdout.readline().decode().split()
        assert words[:4] == ["Tieline", "is", "ready", "at"], self.log[-3000:]
        self.url = words[4]
        self.http = httpx.Client(base_url=self.url, timeout=600.0)

    def stop(self) -> int:
        """Stop in order; give the exit code."""
        self.http.close()
        self._launcher.terminate()
        return self._launcher.wait(20.0 * patience())

    def kill_everything(self) -> None:
        """End launcher, API, worker and computation at once, as a power cut does."""
        self.http.close()
        family = self.processes()
        for process in family:
            process.kill()
        self._launcher.wait()
        wait_until(lambda: not any(alive(process) for process in family), 5.0)

    def answers(self) -> bool:
        """Say whether the API answers, through a connection of its own."""
        try:
            return httpx.get(f"{self.url}/healthz", timeout=5.0 * patience()).is_success
        except httpx.TransportError:
            return False

    # processes

    def processes(self) -> Sequence[psutil.Process]:
        """Launcher first, then all that descend from it."""
        launcher = psutil.Process(self._launcher.pid)
        return [launcher, *launcher.children(recursive=True)]

    def lasting_processes(self) -> set[int]:
        """Process ids of launcher, API and worker."""
        launcher = psutil.Process(self._launcher.pid)
        return {launcher.pid, *(child.pid for child in launcher.children())}

    def worker(self) -> psutil.Process:
        return self.workers()[0]

    def workers(self) -> Sequence[psutil.Process]:
        return self._running("service.worker")

    def apis(self) -> Sequence[psutil.Process]:
        return self._running("service.launcher")

    def computations(self) -> Sequence[psutil.Process]:
        """Give the computing processes: copies of a nursery, called like it, but for those that only practise."""
        found = []
        for process in self._children_of(self._running("service.child"), "service.child"):
            with suppress(psutil.NoSuchProcess):
                if process.name() != SCOUT:
                    found.append(process)
        return found

    def nurseries_of_workers(self) -> Sequence[psutil.Process]:
        """Give the processes that the workers' computations are copies of."""
        return self._children_of(self.workers(), "service.child")

    def _children_of(self, parents: Sequence[psutil.Process], module: str) -> Sequence[psutil.Process]:
        found = []
        for process in self._running(module):
            with suppress(psutil.NoSuchProcess):
                if process.ppid() in {parent.pid for parent in parents}:
                    found.append(process)
        return found

    def _running(self, module: str) -> Sequence[psutil.Process]:
        found = []
        for process in self.processes():
            with suppress(psutil.NoSuchProcess):
                if module in process.cmdline():
                    found.append(process)
        return found

    # storage

    def stored(self) -> set[str]:
        """List all files that clients and jobs have left, and all that is unfinished."""
        data = {path.relative_to(self.home).as_posix() for path in self.data.rglob("*") if path.is_file()}
        temporary = {path.relative_to(self.home).as_posix() for path in self.temporary.rglob("*")}
        found = (data | temporary) - {f"data/{name}" for name in OF_THE_SERVICE}
        return {name for name in found if not name.startswith("data/metrics/")}

    # requests

    def post(self, path: str, **what: Any) -> httpx.Response:
        return self.http.post(path, **what)

    def get(self, path: str) -> httpx.Response:
        return self.http.get(path)

    def upload(self, path: Path) -> Document:
        answer = self.post("/files", files={"file": (path.name, path.read_bytes())})
        assert answer.status_code == 201, answer.text
        return dict(answer.json())

    def execute(self, process: str, inputs: Mapping[str, Any], **headers: str) -> str:
        answer = self.post(f"/processes/{process}/execution", json={"inputs": inputs}, headers=headers)
        assert answer.status_code == 201, answer.text
        return str(answer.json()["jobID"])

    def job(self, job_id: str) -> Document:
        answer = self.http.get(f"/jobs/{job_id}")
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def finished(self, job_id: str, within_s: float = 120.0) -> Document:
        wait_until(lambda: self.job(job_id)["status"] not in {"accepted", "running"}, within_s, every_s=0.1)
        return self.job(job_id)

    def result(self, job_id: str) -> Document:
        """Wait for the end of a job and give its result document."""
        job = self.finished(job_id)
        assert job["status"] == "successful", f"{json.dumps(job)}\n{self.log[-3000:]}"
        return dict(self.http.get(f"/jobs/{job_id}/results").json())

    def echo(self) -> bool:
        """Tell whether a job still passes through API, queue, worker and computation."""
        job = self.execute("echo", {"stringInput": "still here"}, Prefer="respond-async")
        answer = self.result(job)
        assert self.http.delete(f"/jobs/{job}").status_code == 200
        return answer == {"stringInput": "still here"}


@contextmanager
def running_service(home: Path, **settings: str) -> Iterator[RunningService]:
    service = RunningService(home, settings) if settings else RunningService(home)
    service.start()
    try:
        yield service
    finally:
        service.stop()
