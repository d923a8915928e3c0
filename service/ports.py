"""What the service needs of the world: storage of metadata and blobs, and a queue. Adapters provide it."""

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Protocol

from service.errors import ServiceError

Json = dict[str, Any]


class JobStatus(StrEnum):
    """Status of a job, in the words of OGC API - Processes."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCESSFUL = "successful"
    FAILED = "failed"
    DISMISSED = "dismissed"

    @property
    def finished(self) -> bool:
        """Tell whether the status is final."""
        return self in {JobStatus.SUCCESSFUL, JobStatus.FAILED, JobStatus.DISMISSED}


@dataclass(frozen=True)
class Job:
    """One run of a process."""

    id: str
    process_id: str
    inputs: Json
    """Validated inputs as in the request."""
    status: JobStatus
    created: datetime
    started: datetime | None = None
    finished: datetime | None = None
    updated: datetime | None = None
    progress: int = 0
    """Percent."""
    message: str = ""
    """What is being done, or why it ended."""
    attempts: int = 0
    """How often a worker has taken the job up."""
    problem: Json | None = None
    """Problem document of a failed job."""
    file_ids: tuple[str, ...] = ()
    """Files the job reads; they cannot be deleted before it ends."""


@dataclass(frozen=True)
class StoredFile:
    """Metadata of an uploaded file."""

    id: str
    name: str
    bytes: int
    sha256: str
    format: str
    kind: str
    """scan, photo, project or other."""
    created: datetime
    expires: datetime | None = None
    scans: tuple[Json, ...] = ()
    """One document per scan: index, name, points, structured, rows, columns, bounds_m, has_intensity, ..."""
    photos: tuple[Json, ...] = ()

    def summary(self) -> Json:
        """Give what a plan sees of the file."""
        return {name: getattr(self, name) for name in ("name", "sha256", "bytes", "format", "kind")}


@dataclass(frozen=True)
class JobFilter:
    """Which jobs to list."""

    statuses: tuple[JobStatus, ...] = ()
    process_ids: tuple[str, ...] = ()
    limit: int = 100
    offset: int = 0


class JobStore(Protocol):
    """Keep jobs. Every method is one transaction. Status only moves forward: a final status never changes."""

    def create_and_enqueue(self, job: Job) -> None:
        """Insert the job and put it on the queue in one transaction: both or neither."""

    def get(self, job_id: str) -> Job | None:
        """Fetch a job."""

    def find(self, which: JobFilter) -> tuple[Sequence[Job], int]:
        """List jobs, newest first, and the number of all that match."""

    def start(self, job_id: str, now: datetime) -> Job | None:
        """Mark as running and count the attempt; None when the job is gone or final."""

    def report(self, job_id: str, progress: int, message: str, now: datetime) -> bool:
        """Record progress; False when the job is gone or final (the computation should stop)."""

    def succeed(self, job_id: str, now: datetime) -> bool:
        """Mark as successful; False when it was final or gone."""

    def fail(self, job_id: str, problem: Json, now: datetime) -> bool:
        """Mark as failed with its problem document."""

    def dismiss(self, job_id: str, now: datetime) -> Job | None:
        """Mark a waiting or running job as dismissed; return the job as it is then."""

    def delete(self, job_id: str) -> None:
        """Forget a finished job."""

    def unfinished_using(self, file_id: str) -> Job | None:
        """Find an unfinished job that reads a file."""


class FileStore(Protocol):
    """Keep the metadata of files."""

    def add(self, file: StoredFile, place: Callable[[], None] = lambda: None) -> None:
        """Insert.

        Parameters
        ----------
        file
            The metadata.
        place
            Puts the content where it belongs, in the same transaction; meanwhile nobody else adds or removes content
            of this hash. When it raises, the file is not inserted.
        """

    def get(self, file_id: str) -> StoredFile | None:
        """Fetch."""

    def find(self, limit: int, offset: int) -> tuple[Sequence[StoredFile], int]:
        """List, newest first, with the number of all."""

    def contents(self) -> frozenset[str]:
        """Give the hashes of all contents that files have."""

    def delete(self, file_id: str) -> bool:
        """Forget; False when it was unknown."""

    def remove_unused(self, sha256: str, remove: Callable[[], None]) -> bool:
        """Call `remove` if no file has this content, while nobody can add one; tell whether it was called."""

    def forget_lost(self, sha256: str, is_there: Callable[[], bool]) -> int:
        """Forget the files of a content that is not there (any more); give their number."""


class BlobStore(Protocol):
    """Keep bytes under keys such as ``files/<sha256>``, ``features/<hash>.npz``, ``jobs/<id>/result.json``.

    A blob appears whole or not at all (temporary name, fsync, rename).
    """

    async def write_stream(self, key: str, chunks: AsyncIterator[bytes], max_bytes: int) -> tuple[int, str]:
        """Store a stream in constant memory; give its size and sha256. Nothing remains when the stream breaks."""

    def write_bytes(self, key: str, data: bytes) -> None:
        """Store small content."""

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store."""

    def put_copy(self, key: str, path: Path) -> None:
        """Put a finished local file, which is never written again, into the store; the file itself stays."""

    def move(self, key: str, new_key: str) -> None:
        """Rename a blob; what lay under the new key is replaced. FileNotFoundError when absent."""

    def local_path(self, key: str) -> Path:
        """Give a local, readable copy of a blob (the blob itself for a local store). FileNotFoundError when absent."""

    def exists(self, key: str) -> bool:
        """Tell whether the key is stored."""

    def keys(self, prefix: str) -> Sequence[str]:
        """List the keys under a prefix."""

    def unchanged_since(self, prefix: str, moment: datetime) -> Sequence[str]:
        """List the keys under a prefix that were last written before a moment."""

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove unfinished blobs that nobody has written to since a moment; give their number."""

    def delete_prefix(self, prefix: str) -> None:
        """Remove everything under a prefix; nothing happens when there is nothing."""

    def scratch(self) -> Path:
        """Give a new empty directory on the same file system; the caller removes it."""


@dataclass(frozen=True)
class RemoteFile:
    """A file on another server, on its way."""

    name: str
    chunks: AsyncIterator[bytes]
    declared_bytes: int | None = None


class Sources(Protocol):
    """Reach files on other servers, as far as the operator allows."""

    def check(self, href: str) -> None:
        """Refuse an address that is not allowed, without asking anybody. SourceRefusedError says why."""

    def opened(self, href: str) -> AbstractAsyncContextManager[RemoteFile]:
        """Begin to fetch a file. SourceRefusedError: it is not allowed, not there, or not reached."""


@dataclass(frozen=True)
class PendingUpload:
    """What is known of a resumable upload besides its bytes."""

    id: str
    """Also the id of the file that it becomes."""
    filename: str
    length: int
    """Bytes of the whole file."""
    metadata: str
    """As the client sent it."""
    created: datetime
    finished: bool = False
    """The file is entered."""
    problem: Json | None = None
    """Why the complete upload was refused."""


@dataclass(frozen=True)
class UploadState:
    """A resumable upload and how far it is."""

    upload: PendingUpload
    offset: int
    """Bytes that have arrived for good."""
    touched: datetime
    """When the last byte came."""

    @property
    def complete(self) -> bool:
        """Tell whether all bytes are there."""
        return self.offset >= self.upload.length


class OpenUpload(Protocol):
    """A resumable upload that nobody else, in no process, writes to until it is closed."""

    @property
    def state(self) -> UploadState:
        """Tell how far it is."""

    @property
    def path(self) -> Path:
        """Give the file with the bytes."""

    def touch(self) -> None:
        """Note that somebody is about to write."""

    def write(self, data: bytes) -> None:
        """Append."""

    def sync(self) -> None:
        """Make durable what was written."""

    def doubt(self) -> None:
        """Declare all that is written from now on as not verified; it goes if the process dies before `trust`."""

    def trust(self) -> None:
        """Declare what was written as verified."""

    def cut(self) -> None:
        """Remove what is not verified."""

    def asked_for(self) -> bool:
        """Tell whether another request wants the upload."""

    def save(self, upload: PendingUpload) -> None:
        """Record a change; the bytes of an upload that is finished or refused go."""

    def remove(self) -> None:
        """Remove the upload."""

    def close(self) -> None:
        """Let others have it."""


class UploadStore(Protocol):
    """Keep resumable uploads: the offset is the size of the file on disk."""

    def create(self, upload: PendingUpload) -> None:
        """Enter a new upload, which is empty."""

    def find(self, upload_id: str) -> UploadState:
        """Tell how far an upload is. NoSuchUploadError when it is unknown."""

    def lock(self, upload_id: str) -> OpenUpload | None:
        """Open an upload; None while it is open elsewhere. NoSuchUploadError when it is unknown."""

    def ask_for(self, upload_id: str) -> None:
        """Let whoever has the upload open know that it is wanted."""

    def ids(self) -> Sequence[str]:
        """List all uploads."""

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove what killed processes left half-made before a moment; give the number."""


class Queue(Protocol):
    """Steer the engine from the web process."""

    def cancel(self, job_id: str) -> None:
        """Ask that a job's computation stop (within 5 s)."""

    def live_workers(self) -> int:
        """Count workers whose heart beats."""


@dataclass(frozen=True)
class StepCall:
    """One computation that runs in a process of its own."""

    name: str
    """Name of the step, e.g. ``features``."""
    arguments: Json
    """Small JSON: ids, options, keys of blobs; never arrays."""
    label: str
    """What a person reads while it runs, e.g. ``features of S1``."""
    weight: float = 1.0
    """Share of the job's progress relative to the other steps."""


class StepProgress(Protocol):
    """Receive the progress of one step."""

    def report(self, fraction: float, message: str) -> None:
        """Say that `fraction` (0..1) of the step is done."""


class Plan(Protocol):
    """Turn a job's inputs into stages of steps. Deterministic: the same outputs give the same next stage."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage.

        Parameters
        ----------
        job
            ``{"id", "process_id", "inputs", "files"}``; ``files`` maps the id of each file that the job reads to its
            ``{"name", "sha256"}``.
        outputs
            The outputs of each finished stage, in the order of its calls.

        Returns
        -------
        Steps that may run side by side, or None when all is done. The last stage writes ``jobs/<id>/result.json``.
        """

    def total_weight(self, job: Json) -> float:
        """Estimate the sum of the weights of all stages, those not planned yet included; progress is a share of it."""


@dataclass(frozen=True)
class StepContext:
    """What a step may use besides its arguments."""

    blobs: BlobStore
    progress: StepProgress
    limits: Mapping[str, int] = field(default_factory=dict)


class StepFailedError(ServiceError):
    """Carry the problem document of a step that failed in another process, unchanged.

    Parameters
    ----------
    problem
        Becomes the answer of `service.errors.to_problem` as it is.
    """

    def __init__(self, problem: Json) -> None:
        self.problem = problem
        super().__init__(str(problem.get("detail") or problem["title"]))

    def extra(self) -> Json:
        """Give the whole document."""
        return self.problem


class StepRunner(Protocol):
    """Run one step in a process of its own, with limits."""

    async def run(
        self, step: str, arguments: Json, *, timeout_s: float, on_progress: Callable[[float, str], None] | None = None
    ) -> Json:
        """Give the step's output.

        Cancelling the awaiting task kills the process and all it started.

        Raises
        ------
        StepFailedError
            The step itself reported what is wrong, or took longer than `timeout_s`; trying again would not help.
        ComputationFailedError
            The process died without a report; the message tells how, and its last words.
        """


@dataclass(frozen=True)
class LogLine:
    """One line of a job's log."""

    time: datetime
    level: str
    """info, warning or error."""
    text: str


class JobLog(Protocol):
    """Keep what happened to each job; it goes with the job."""

    def write(self, job_id: str, lines: Sequence[LogLine]) -> None:
        """Add lines to a job's log; nothing happens when the job is gone."""

    def read(self, job_id: str, limit: int) -> Sequence[LogLine]:
        """Give the last lines of a job's log, in the order in which they were written."""


class StepLedger(Protocol):
    """Keep how far each step of a job is. A job's progress is the weighted mean over its steps."""

    def plan_stage(self, job_id: str, stage: int, weights: Sequence[float], total_weight: float) -> None:
        """Note the steps of a stage; noting them again changes nothing."""

    def begin_step(self, job_id: str, label: str, now: datetime) -> bool:
        """Mark the job as running if it was waiting; False when it is gone or final (the step must not run)."""

    def report_step(self, job_id: str, stage: int, index: int, fraction: float, message: str, now: datetime) -> bool:
        """Record how far a step is; False when the job is gone or final."""


class ExecutorRegistry(Protocol):
    """Know which workers live."""

    def register(self, executor_id: str) -> None:
        """Enter a worker."""

    def beat(self, executor_id: str) -> bool:
        """Say that a worker lives; False when it was taken for dead meanwhile (it must stop at once)."""

    def remove(self, executor_id: str) -> None:
        """Strike out a worker that stops in order."""

    def bury_dead(self, executor_id: str) -> None:
        """Strike out workers whose process is gone or whose heart has not beaten for a while, except the caller."""

    def live(self) -> Sequence[str]:
        """List the workers that are entered and not overdue."""

    def entered(self) -> Sequence[str]:
        """List all workers that are entered."""

    def lease(self, name: str, holder: str, seconds: float) -> bool:
        """Take or keep a named lease; False while someone else holds it."""
