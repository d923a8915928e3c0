"""The service under test: in this process with jobs that end when asked about, and as users run it."""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import httpx
import pytest

from service.dependencies import Adapters
from service.ports import JobFilter, JobStatus
from service.settings import Settings
from tests.api.conftest import Client, FakeSteps
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue
from tests.e2e.running.running_service import RunningService, running_service

Document = dict[str, Any]
AS_JSON = {"Accept": "application/json"}


class Sender(Protocol):
    """Sends requests."""

    def request(self, method: str, path: str, **what: Any) -> httpx.Response: ...


class Server(ABC):
    """What the test suite asks for."""

    def __init__(self, sender: Sender) -> None:
        self._sender = sender

    def get(self, path: str, **headers: str) -> httpx.Response:
        return self._sender.request("GET", path, headers={**AS_JSON, **headers})

    def delete(self, path: str) -> httpx.Response:
        return self._sender.request("DELETE", path, headers=AS_JSON)

    def execute(self, body: Document, process: str = "echo", **headers: str) -> httpx.Response:
        path = f"/processes/{process}/execution"
        return self._sender.request("POST", path, json=body, headers={**AS_JSON, **headers})

    def job(self, body: Document) -> httpx.Response:
        """Make a job; give its status document."""
        answer = self.execute(body, Prefer="respond-async")
        assert answer.status_code == 201, answer.text
        return self.get(answer.headers["location"])

    @abstractmethod
    def finished(self, body: Document) -> Document:
        """Make a job and wait for its end."""


class InProcess(Server):
    """The application over memory adapters, where a worker works when somebody waits for it."""

    def __init__(self, sender: Sender, adapters: Adapters) -> None:
        super().__init__(sender)
        self._adapters = adapters

    def finished(self, body: Document) -> Document:
        job_id = self.job(body).json()["jobID"]
        jobs, blobs = self._adapters.jobs, self._adapters.blobs
        assert isinstance(blobs, MemoryBlobStore)
        for job in jobs.find(JobFilter(statuses=(JobStatus.ACCEPTED,)))[0]:
            blobs.write_bytes(f"jobs/{job.id}/result.json", json.dumps(job.inputs).encode())
            jobs.start(job.id, job.created)
            jobs.succeed(job.id, job.created)
        return dict(self.get(f"/jobs/{job_id}").json())


class Running(Server):
    """The service as users run it."""

    def __init__(self, service: RunningService) -> None:
        super().__init__(service.http)
        self._service = service

    def finished(self, body: Document) -> Document:
        job_id = self.job(body).json()["jobID"]
        return self._service.finished(job_id)


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    home: Path = tmp_path_factory.mktemp("conformance")
    with running_service(home) as running:
        yield running


@pytest.fixture(scope="session")
def in_process(tmp_path_factory: pytest.TempPathFactory) -> InProcess:
    blobs = MemoryBlobStore()
    adapters = Adapters(MemoryJobStore(), MemoryFileStore(), blobs, MemoryQueue(), FakeSteps(blobs), MemoryJobLog())
    settings = Settings(data_dir=tmp_path_factory.mktemp("in_process"), min_free_bytes=0)
    return InProcess(Client(create_app(settings, adapters)), adapters)


@pytest.fixture(params=["in process", pytest.param("running", marks=pytest.mark.service)])
def server(request: pytest.FixtureRequest) -> Server:
    if request.param == "running":
        return Running(request.getfixturevalue("service"))
    found: InProcess = request.getfixturevalue("in_process")
    return found


@pytest.fixture
def echo(server: Server) -> Document:
    """Give the description of the echo process."""
    return dict(server.get("/processes/echo").json())
