"""Requests made from the description of the interface, right ones and wrong ones: the answers are those it describes.

`TIELINE_FUZZ_REQUESTS` is the number of requests of each kind to each operation.
"""

import itertools
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import hypothesis
import pytest
import schemathesis
from schemathesis.generation import GenerationMode
from schemathesis.specs.openapi.checks import positive_data_acceptance

from service.dependencies import Adapters
from service.ports import Job, JobStatus
from service.processes import OFFERED_PROCESSES
from service.settings import Settings
from tests.api.conftest import Client, FakeSteps
from tests.doubles.application import create_app
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobLog, MemoryJobStore, MemoryQueue

pytestmark = pytest.mark.service

REQUESTS = int(os.environ.get("TIELINE_FUZZ_REQUESTS", "25"))
NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
RESOURCES = ("processes", "jobs", "files", "uploads", "registrations", "keys", "audit")
FINISHED = [status for status in JobStatus if status.finished]
ENDED = {"started": NOW, "finished": NOW + timedelta(seconds=3)}
PROBLEM = {"type": "about:blank", "title": "Unusable input", "status": 400, "detail": "no scan"}
TUS = {"Tus-Resumable": "1.0.0", "Upload-Length": "3", "Upload-Offset": "0", "Upload-Metadata": "filename YS54eXo="}
RAW = ("application/offset+octet-stream", "application/octet-stream")
EXAMPLES = hypothesis.settings(
    max_examples=REQUESTS,
    derandomize=True,
    database=None,
    phases=[hypothesis.Phase.generate],
    suppress_health_check=list(hypothesis.HealthCheck),
)


@schemathesis.serializer(*RAW)
def _as_it_is(_context: schemathesis.SerializationContext, value: Any) -> bytes:
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "replace")


class Scene:
    """An application with jobs of every status, files and uploads."""

    def __init__(self, home: Path) -> None:
        self.blobs = MemoryBlobStore()
        self.adapters = Adapters(
            MemoryJobStore(), MemoryFileStore(), self.blobs, MemoryQueue(), FakeSteps(self.blobs), MemoryJobLog()
        )
        settings = Settings(data_dir=home, max_file_bytes=1_000_000, min_free_bytes=0, max_queued_jobs=100_000)
        self.app = create_app(settings, self.adapters)
        self._client = Client(self.app)
        self._numbers = itertools.count()

    def job(self, statuses: Sequence[JobStatus] = tuple(JobStatus)) -> str:
        number = next(self._numbers)
        status = statuses[number % len(statuses)]
        job = Job(f"job{number}", "echo", {"stringInput": "a"}, status, NOW, updated=NOW)
        if status.finished:
            job = replace(job, **ENDED, problem=PROBLEM if status is JobStatus.FAILED else None)
        self.adapters.jobs.create_and_enqueue(job)
        if status is JobStatus.SUCCESSFUL:
            self.blobs.write_bytes(f"jobs/{job.id}/result.json", b'{"stringInput": "a", "pairs": [1, 2]}')
            self.blobs.write_bytes(f"jobs/{job.id}/artifacts/poses.csv", b"station\n")
        return job.id

    def file(self) -> str:
        return self._client.upload(content=b"1 2 3\n%d" % next(self._numbers))

    def upload(self) -> str:
        answer = self._client.post("/uploads", headers=TUS)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"].rpartition("/")[2]

    def something_for(self, parameter: str) -> str:
        """Give a path parameter that exists."""
        number = next(self._numbers)
        makers = {"job_id": self.job, "file_id": self.file, "upload_id": self.upload, "name": lambda: "poses.csv"}
        makers["list_name"] = lambda: "pairs"
        if parameter == "process_id":
            return list(OFFERED_PROCESSES)[number % len(OFFERED_PROCESSES)]
        return makers[parameter]() if parameter in makers else "none"

    def check_answer(self, case: Any) -> None:
        """Send a request, two of three to something that exists, and check its answer."""
        if next(self._numbers) % 3:
            for name in case.path_parameters:
                case.path_parameters[name] = self.something_for(name)
            if case.operation.path.endswith("/events"):  # those of an unfinished job go on
                case.path_parameters["job_id"] = self.job(FINISHED)
        if isinstance(case.body, dict) and isinstance(case.body.get("inputs"), dict):
            case.body["inputs"].pop("pause", None)
        headers = TUS if "uploads" in case.operation.path else None
        # right by the schema is not yet right: files must exist, a registration has two scans
        case.call_and_validate(headers=headers, excluded_checks=[positive_data_acceptance])


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return Scene(tmp_path_factory.mktemp("described"))


@pytest.fixture(scope="module", params=["/openapi.json", "/openapi-3.0.json"])
def description(request: pytest.FixtureRequest, scene: Scene) -> Any:
    return schemathesis.openapi.from_asgi(request.param, scene.app)


def can_be_wrong(operation: Any) -> bool:
    """Tell whether anything but a path, where every text is right, can be wrong about a request."""
    return bool(operation.query) or any(body.media_type == "application/json" for body in operation.body)


def operations(description: Any, resource: str) -> Iterator[Any]:
    for found in description.get_all_operations():
        operation = found.ok()
        if operation.path.split("/")[1] == resource:
            yield operation


@pytest.mark.parametrize("mode", GenerationMode)
@pytest.mark.parametrize("resource", RESOURCES)
def test_answers_are_as_described(scene: Scene, description: Any, resource: str, mode: GenerationMode) -> None:
    for operation in operations(description, resource):
        if mode is GenerationMode.NEGATIVE and not can_be_wrong(operation):
            continue
        check = EXAMPLES(hypothesis.given(case=operation.as_strategy(mode))(scene.check_answer))
        check()


@pytest.mark.parametrize("path", ["/", "/conformance", "/healthz", "/readyz", "/metrics"])
def test_fixed_documents_are_as_described(description: Any, path: str) -> None:
    description[path]["GET"].Case().call_and_validate()
