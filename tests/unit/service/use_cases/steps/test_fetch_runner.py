"""The steps by which a job gets files of other servers: done once, for its project, with all that may go wrong."""

import asyncio
import hashlib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from service.adapters.uploads.local_uploads import LocalUploads
from service.errors import (
    AddressRefusedError,
    ComputationFailedError,
    InsufficientStorageError,
    ServiceError,
    StorageError,
    UnreadableFileError,
    to_problem,
)
from service.ports import Job, JobStatus, Json, RemoteFile, StepContext, StepFailedError
from service.processes import OFFERED_PROCESSES, PLANS
from service.settings import Settings
from service.use_cases.inputs.fetch_files import Fetch
from service.use_cases.limits.quotas import Belongings
from service.use_cases.steps.fetch_runner import FetchingRunner
from service.use_cases.steps.run_fetch import fetch_file
from service.use_cases.uploads.store_files import FileIntake
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobStore

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
CONTENT = b"scan " * 1000
SHA256 = hashlib.sha256(CONTENT).hexdigest()
FETCH = Fetch("f1", "https://x.org/a.e57", ("/inputs/station/scan",), "S")
SCAN = {"name": "S", "scan": {"file": "f1", "index": 0}}
JOB = Job(
    *("j", "extract-lines", {"station": SCAN}, JobStatus.ACCEPTED, NOW),
    file_ids=("f1",),
    owner="ours",
    fetches=(FETCH.to_json(),),
)


class Elsewhere:
    def __init__(self, *chunks: bytes | Exception, declared: int | None = len(CONTENT)) -> None:
        self._chunks = chunks
        self._declared = declared

    def check(self, href: str) -> None:
        raise AssertionError(href)

    @asynccontextmanager
    async def opened(self, href: str) -> AsyncIterator[RemoteFile]:
        async def chunks() -> AsyncIterator[bytes]:
            for chunk in self._chunks:
                if isinstance(chunk, Exception):
                    raise chunk
                yield chunk

        yield RemoteFile(href.rpartition("/")[2], chunks(), self._declared)


class Reports:
    def __init__(self) -> None:
        self.heard: list[tuple[float, str]] = []

    def report(self, fraction: float, message: str) -> None:
        self.heard.append((fraction, message))


class Processes:
    """Run steps at once: fetch from elsewhere, and find one scan in every file."""

    def __init__(self, blobs: MemoryBlobStore, elsewhere: Elsewhere) -> None:
        self.blobs = blobs
        self.elsewhere = elsewhere
        self.calls: list[str] = []
        self.reports = Reports()
        self.inspection: Json | ServiceError = {"format": "E57", "kind": "scan", "scans": [{"index": 0}], "photos": []}
        self.nobody_waits_any_more = False

    async def run(
        self,
        step: str,
        arguments: Json,
        *,
        timeout_s: float,  # noqa: ARG002 - the port's signature
        on_progress: Callable[[float, str], None] | None = None,  # noqa: ARG002
    ) -> Json:
        self.calls.append(step)
        if step == "inspect-file":
            if isinstance(self.inspection, ServiceError):
                raise self.inspection
            return self.inspection
        if step != "fetch-file":
            return {"ran": step}
        context = StepContext(self.blobs, self.reports, {"min_free_bytes": 0}, self.elsewhere)
        try:
            fetched = await asyncio.to_thread(fetch_file, context, arguments)
        except ServiceError as error:
            raise StepFailedError(to_problem(error)) from None
        if self.nobody_waits_any_more:
            raise asyncio.CancelledError
        return fetched


class Scene:
    def __init__(self, directory: Path, elsewhere: Elsewhere | None = None, **settings: Any) -> None:
        self.blobs, self.files, self.jobs = MemoryBlobStore(), MemoryFileStore(), MemoryJobStore()
        self.processes = Processes(self.blobs, elsewhere or Elsewhere(CONTENT[:3000], CONTENT[3000:]))
        made = Settings(data_dir=directory, min_free_bytes=0, **settings)
        belongings = Belongings(self.files, self.jobs, LocalUploads(directory / "uploads"))
        self.runner = FetchingRunner(
            self.processes, FileIntake(belongings, self.blobs, self.processes, made), self.jobs, OFFERED_PROCESSES
        )
        self.jobs.create_and_enqueue(JOB)

    def run(self, step: str = "fetch-file") -> Json:
        arguments = {"job_id": "j", "id": "f1"} if step == "fetch-file" else {"job_id": "j"}
        return asyncio.run(self.runner.run(step, arguments, timeout_s=5.0))

    def problem(self, step: str = "fetch-file") -> Json:
        with pytest.raises(StepFailedError) as failure:
            self.run(step)
        return failure.value.problem

    def is_empty(self) -> bool:
        return not self.blobs.keys("") and not self.files.contents()


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


def test_the_file_is_entered_for_the_project_of_the_job_under_the_promised_identifier(scene: Scene) -> None:
    output = scene.run()
    assert output == {
        "id": "f1",
        "name": "a.e57",
        "sha256": SHA256,
        "bytes": len(CONTENT),
        "format": "E57",
        "kind": "scan",
        "owner": "ours",
    }
    file = scene.files.of("ours").get("f1")
    assert file is not None
    assert scene.files.of("theirs").get("f1") is None
    assert scene.blobs.keys("") == [f"files/{SHA256}"]


def test_a_file_that_was_entered_though_nobody_heard_of_it_is_not_fetched_again(scene: Scene) -> None:
    first = scene.run()
    assert scene.run() == first
    assert scene.processes.calls.count("fetch-file") == 1


def test_how_far_it_is_can_be_read(scene: Scene) -> None:
    scene.run()
    assert scene.processes.reports.heard == [(0.6, "60 %"), (1.0, "100 %")]


def test_how_far_it_is_can_be_read_though_nobody_knows_its_size(tmp_path: Path) -> None:
    scene = Scene(tmp_path, Elsewhere(bytes(2_500_000), declared=None))
    scene.run()
    assert scene.processes.reports.heard == [(0.0, "2 MB")]


@pytest.mark.parametrize(
    ("elsewhere", "status"),
    [
        (Elsewhere(CONTENT, AddressRefusedError("https://x.org/a.e57", "it broke off")), 400),
        (Elsewhere(b"", declared=0), 400),
        (Elsewhere(CONTENT, declared=1_000_001), 413),
        (Elsewhere(*[CONTENT] * 300, declared=None), 413),
        (Elsewhere(InsufficientStorageError("full")), 507),
    ],
)
def test_what_does_not_come_whole_fails_the_job_with_a_pointer_and_leaves_nothing(
    tmp_path: Path, elsewhere: Elsewhere, status: int
) -> None:
    scene = Scene(tmp_path, elsewhere, max_file_bytes=1_000_000)
    problem = scene.problem()
    assert problem["status"] == status
    assert [fault["pointer"] for fault in problem["errors"]] == ["/inputs/station/scan/href"]
    assert scene.is_empty()


def test_what_the_project_has_no_room_for_is_not_fetched_to_its_end(tmp_path: Path) -> None:
    scene = Scene(tmp_path, max_project_bytes=4_999)
    assert scene.problem()["status"] == 413
    assert scene.is_empty()


def test_results_leave_less_room_for_what_is_fetched(tmp_path: Path) -> None:
    scene = Scene(tmp_path, max_project_bytes=5_100)
    scene.jobs.note_results(JOB.id, 101)
    assert scene.problem()["status"] == 413


@pytest.mark.parametrize(
    ("inspection", "title"),
    [
        (StepFailedError(to_problem(UnreadableFileError("a.e57", "no scan"))), "Unreadable file"),
        (ComputationFailedError("killed by signal 11"), "Unreadable file"),
    ],
)
def test_what_cannot_be_read_fails_the_job_and_leaves_nothing(
    scene: Scene, inspection: ServiceError, title: str
) -> None:
    scene.processes.inspection = inspection
    problem = scene.problem()
    assert (problem["status"], problem["title"]) == (400, title)
    assert problem["errors"][0]["pointer"] == "/inputs/station/scan/href"
    assert scene.is_empty()


def test_what_has_come_when_the_job_is_dismissed_at_that_moment_does_not_stay(scene: Scene) -> None:
    scene.processes.nobody_waits_any_more = True
    with pytest.raises(asyncio.CancelledError):
        scene.run()
    assert scene.is_empty()


def test_a_storage_that_is_away_is_tried_again(scene: Scene) -> None:
    scene.processes.inspection = StorageError("away")
    with pytest.raises(ComputationFailedError, match="away"):
        scene.run()


def test_the_files_are_checked_when_they_have_come(scene: Scene) -> None:
    scene.run()
    assert scene.run("check-files") == {}


def test_what_the_files_do_not_have_is_pointed_at_as_the_client_wrote_it(scene: Scene) -> None:
    scene.processes.inspection = {"format": "JPEG", "kind": "photo", "scans": [], "photos": []}
    scene.run()
    assert [fault["pointer"] for fault in scene.problem("check-files")["errors"]] == ["/inputs/station/scan/href"]


def test_other_steps_run_where_they_belong(scene: Scene) -> None:
    assert asyncio.run(scene.runner.run("features", {}, timeout_s=5.0)) == {"ran": "features"}


def test_a_plan_goes_on_with_fetched_files_as_with_uploaded_ones() -> None:
    summary = {"name": "a.e57", "sha256": SHA256, "bytes": 5, "format": "E57", "kind": "scan"}
    plan = PLANS["extract-lines"]
    job = {"id": "j", "process_id": "extract-lines", "inputs": JOB.inputs, "files": {}, "fetches": [FETCH.to_json()]}
    fetching = plan.next_stage(job, [])
    checking = plan.next_stage(job, [[{"id": "f1", **summary}]])
    assert fetching is not None
    assert checking is not None
    assert [(call.name, call.label) for call in (*fetching, *checking)] == [
        *(("fetch-file", "fetching S"), ("check-files", "checking the files")),
    ]
    uploaded = {**job, "files": {"f1": summary}, "fetches": []}
    assert plan.next_stage(job, [[{"id": "f1", **summary}], [{}]]) == plan.next_stage(uploaded, [])
    features = [{"features": "k"}]
    assert plan.next_stage(job, [[{"id": "f1", **summary}], [{}], features]) == plan.next_stage(uploaded, [features])
    # what the store says of the file meanwhile changes nothing
    later = {**job, "files": {"f1": {**summary, "name": "other.e57"}}}
    assert plan.next_stage(later, [[{"id": "f1", **summary}], [{}]]) == plan.next_stage(uploaded, [])
    assert plan.total_weight(job) > plan.total_weight(uploaded)
