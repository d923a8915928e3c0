"""Jobs, files, blobs and a queue in memory, for tests."""

import hashlib
import json
import shutil
import tempfile
import threading
import weakref
from collections.abc import AsyncIterator, Callable, Sequence
from copy import copy
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from service.adapters.files.local_files import LocalFiles, checked_key
from service.errors import FileTooLargeError
from service.ports import (
    Job,
    JobFilter,
    JobState,
    JobStatus,
    Json,
    JsonText,
    LogLine,
    StepFigures,
    StoredAmount,
    StoredFile,
    UnfinishedJobs,
    admit_any,
    admit_any_file,
    narrowed,
)

NO_STEPS = StepFigures(0, 0, 0.0, {})


class MemoryJobStore:
    """Keep jobs in a dictionary.

    Parameters
    ----------
    enqueue
        Called with each new job; when it raises, the job is not kept.
    """

    def __init__(self, enqueue: Callable[[Job], None] = lambda _job: None) -> None:
        self._jobs: dict[str, Job] = {}
        self._results: dict[str, int] = {}
        self._enqueue = enqueue
        self._lock = threading.RLock()
        self._owner: str | None = None

    def of(self, owner: str) -> "MemoryJobStore":
        """Give the jobs of one project."""
        bound = copy(self)
        bound._owner = narrowed(self._owner, owner)
        return bound

    def create_and_enqueue(
        self,
        job: Job,
        admit: Callable[[UnfinishedJobs], None] = admit_any,
        inputs: JsonText | None = None,
        total_weight: float = 0.0,  # noqa: ARG002 - the port's signature
    ) -> None:
        """Insert the job and put it on the queue: both or neither."""
        job = job if inputs is None else replace(job, inputs=json.loads(inputs))
        if self._owner is not None:
            job = replace(job, owner=self._owner)
        with self._lock:
            unfinished = [each.owner for each in self._jobs.values() if not each.status.finished]
            admit(UnfinishedJobs(unfinished.count(job.owner), len(unfinished)))
            self._enqueue(job)
            self._jobs[job.id] = job

    def whole(self, job_id: str) -> Job | None:
        """Fetch a job with its inputs."""
        return self.get(job_id)

    def inputs_text(self, job_id: str) -> JsonText | None:
        """Fetch the inputs of a job as they are kept."""
        job = self.get(job_id)
        return None if job is None else JsonText(json.dumps(job.inputs))

    def get(self, job_id: str) -> Job | None:
        """Fetch a job."""
        job = self._jobs.get(job_id)
        return job if job is not None and self._owner in {None, job.owner} else None

    async def look(self, job_id: str) -> JobState | None:
        """Tell where a job stands."""
        job = self.get(job_id)
        return None if job is None else JobState(**{each.name: getattr(job, each.name) for each in fields(JobState)})

    def find(self, which: JobFilter) -> tuple[Sequence[Job], int]:
        """List jobs, newest first, and the number of all that match."""
        with self._lock:
            found = [job for job in self._jobs.values() if self._owner in {None, job.owner} and which.admits(job)]
        found.sort(key=lambda job: (job.created, job.id), reverse=True)
        return found[which.offset : which.offset + which.limit], len(found)

    def start(self, job_id: str, now: datetime) -> Job | None:
        """Mark as running and count the attempt; None when the job is gone or final."""
        with self._lock:
            job = self.get(job_id)
            if job is None:
                return None
            started = job.started or now
            return self._change(
                job_id, status=JobStatus.RUNNING, attempts=job.attempts + 1, started=started, updated=now
            )

    def report(self, job_id: str, progress: int, message: str, now: datetime) -> bool:
        """Record progress, which never goes back; False when the job is gone or final."""
        with self._lock:
            job = self.get(job_id)
            progress = max(progress, job.progress if job else 0)
            return self._change(job_id, progress=progress, message=message, updated=now) is not None

    def succeed(self, job_id: str, now: datetime) -> bool:
        """Mark as successful; False when it was final or gone."""
        final = {"status": JobStatus.SUCCESSFUL, "progress": 100, "message": "done"}
        return self._change(job_id, **final, updated=now, finished=now) is not None

    def fail(self, job_id: str, problem: Json, now: datetime) -> bool:
        """Mark as failed with its problem document."""
        message = str(problem.get("detail") or problem.get("title") or "failed")
        final = {"status": JobStatus.FAILED, "problem": problem, "message": message}
        return self._change(job_id, **final, updated=now, finished=now) is not None

    def dismiss(self, job_id: str, now: datetime) -> Job | None:
        """Mark a waiting or running job as dismissed; return the job as it is then."""
        final = {"status": JobStatus.DISMISSED, "message": "dismissed on request"}
        return self._change(job_id, **final, updated=now, finished=now) or self.get(job_id)

    def delete(self, job_id: str) -> None:
        """Forget a finished job; an unfinished one stays."""
        with self._lock:
            job = self.get(job_id)
            if job is not None and job.status.finished:
                del self._jobs[job_id]

    def note_results(self, job_id: str, size: int) -> None:
        """Note how many bytes are stored of a job."""
        if self.get(job_id) is not None:
            self._results[job_id] = size

    def results_bytes(self) -> int:
        """Sum up what was noted."""
        with self._lock:
            return sum(size for job_id, size in self._results.items() if self.get(job_id) is not None)

    def inputs_bytes(self) -> int:
        """Sum up the inputs of all jobs as they are kept."""
        with self._lock:
            return sum(len(json.dumps(job.inputs)) for job in self._jobs.values() if self._owner in {None, job.owner})

    def uncounted(self, before: datetime, limit: int) -> Sequence[str]:
        """List jobs that ended before a moment and of whose results nothing was noted."""
        with self._lock:
            ended = [job.id for job in self._jobs.values() if job.finished is not None and job.finished < before]
        return [job_id for job_id in ended if job_id not in self._results and self.get(job_id) is not None][:limit]

    def unfinished_using(self, file_id: str) -> Job | None:
        """Find an unfinished job that reads a file."""
        with self._lock:
            mine = (job for job in self._jobs.values() if self._owner in {None, job.owner})
            return next((job for job in mine if file_id in job.file_ids and not job.status.finished), None)

    def _change(self, job_id: str, **values: Any) -> Job | None:
        with self._lock:
            job = self.get(job_id)
            if job is None or job.status.finished:
                return None
            self._jobs[job_id] = replace(job, **values)
            return self._jobs[job_id]


class MemoryJobLog:
    """Keep the lines of each job in a list."""

    def __init__(self) -> None:
        self._lines: dict[str, list[LogLine]] = {}

    def of(self, owner: str) -> "MemoryJobLog":  # noqa: ARG002 - it does not know whose jobs they are
        """Give the log of the jobs of one project, here: of all."""
        return self

    def write(self, job_id: str, lines: Sequence[LogLine]) -> None:
        """Add lines to a job's log."""
        self._lines.setdefault(job_id, []).extend(lines)

    def read(self, job_id: str, limit: int) -> Sequence[LogLine]:
        """Give the last lines of a job's log, in the order in which they were written."""
        return self._lines.get(job_id, [])[-limit:]


class MemoryFileStore:
    """Keep the metadata of files in a dictionary."""

    def __init__(self) -> None:
        self._files: dict[str, StoredFile] = {}
        self._lock = threading.RLock()
        self._owner: str | None = None

    def of(self, owner: str) -> "MemoryFileStore":
        """Give the files of one project; contents are shared by all."""
        bound = copy(self)
        bound._owner = narrowed(self._owner, owner)
        return bound

    def amount(self) -> StoredAmount:
        """Sum up the files."""
        with self._lock:
            return _amount(self._mine())

    def add(
        self,
        file: StoredFile,
        place: Callable[[], None] = lambda: None,
        admit: Callable[[StoredAmount], None] = admit_any_file,
    ) -> StoredFile:
        """Insert; `place` puts the content where it belongs."""
        if self._owner is not None:
            file = replace(file, owner=self._owner)
        with self._lock:
            mine = [each for each in self._files.values() if each.owner == file.owner]
            admit(_amount(mine))
            place()
            twins = [each.computed_bytes for each in mine if each.sha256 == file.sha256]
            file = replace(file, computed_bytes=max(twins, default=0))
            self._files[file.id] = file
            return file

    def get(self, file_id: str) -> StoredFile | None:
        """Fetch."""
        file = self._files.get(file_id)
        return file if file is not None and self._owner in {None, file.owner} else None

    def find(self, limit: int, offset: int) -> tuple[Sequence[StoredFile], int]:
        """List, newest first, with the number of all."""
        with self._lock:
            found = sorted(self._mine(), key=lambda file: (file.created, file.id), reverse=True)
        return found[offset : offset + limit], len(found)

    def contents(self) -> frozenset[str]:
        """Give the hashes of all contents that files have."""
        with self._lock:
            return frozenset(file.sha256 for file in self._files.values())

    def delete(self, file_id: str) -> bool:
        """Forget; False when it was unknown."""
        with self._lock:
            return self.get(file_id) is not None and self._files.pop(file_id, None) is not None

    def note_computed(self, sha256: str, size: int) -> None:
        """Note how many bytes are kept of what was computed of a content."""
        with self._lock:
            for file in self._mine():
                if file.sha256 == sha256:
                    self._files[file.id] = replace(file, computed_bytes=size)

    def remove_unused(self, sha256: str, remove: Callable[[], None], owner: str | None = None) -> bool:
        """Call `remove` if no file has this content; tell whether it was called."""
        with self._lock:
            unused = not any(each.sha256 == sha256 and owner in {None, each.owner} for each in self._files.values())
            if unused:
                remove()
            return unused

    def forget_lost(self, sha256: str, is_there: Callable[[], bool]) -> int:
        """Forget the files of a content that is not there (any more); give their number."""
        with self._lock:
            lost = [] if is_there() else [file.id for file in self._files.values() if file.sha256 == sha256]
            for file_id in lost:
                del self._files[file_id]
            return len(lost)

    def _mine(self) -> list[StoredFile]:
        return [file for file in self._files.values() if self._owner in {None, file.owner}]


def _amount(files: Sequence[StoredFile]) -> StoredAmount:
    return StoredAmount(len(files), sum(file.bytes + file.computed_bytes for file in files))


class MemoryBlobStore:
    """Keep blobs in a dictionary; `local_path` and `scratch` use a temporary directory that ends with the store."""

    def __init__(self) -> None:
        self._blobs: dict[str, bytes] = {}
        self._written: dict[str, datetime] = {}
        directory = tempfile.mkdtemp(prefix="tieline-memory-")
        weakref.finalize(self, shutil.rmtree, directory, ignore_errors=True)
        self._files, self._copies = LocalFiles(Path(directory)), Path(directory) / "copies"

    async def write_stream(
        self,
        key: str,
        chunks: AsyncIterator[bytes],
        max_bytes: int,
        expected_bytes: int = 0,  # noqa: ARG002 - the port's signature
    ) -> tuple[int, str]:
        """Store a stream; give its size and sha256. Nothing remains when the stream breaks."""
        data = bytearray()
        async for chunk in chunks:
            data += chunk
            if len(data) > max_bytes:
                raise FileTooLargeError("the upload", len(data), max_bytes)
        self.write_bytes(key, bytes(data))
        return len(data), hashlib.sha256(data).hexdigest()

    def write_bytes(self, key: str, data: bytes) -> None:
        """Store small content."""
        self._blobs[checked_key(key)] = data
        self._written[key] = datetime.now(UTC)

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store."""
        self.put_copy(key, path)
        path.unlink()

    def put_copy(self, key: str, path: Path) -> None:
        """Put a finished local file into the store; the file itself stays."""
        self.write_bytes(key, path.read_bytes())

    def prepare_move(self, key: str, new_key: str) -> None:
        """Do nothing: a move is quick."""

    def move(self, key: str, new_key: str) -> None:
        """Rename a blob; what lay under the new key is replaced. FileNotFoundError when absent."""
        if key not in self._blobs:
            raise FileNotFoundError(key)
        self.write_bytes(new_key, self._blobs.pop(key))
        self._written[new_key] = self._written.pop(key)

    def local_path(self, key: str) -> Path:
        """Give a local copy of a blob. FileNotFoundError when absent."""
        if key not in self._blobs:
            raise FileNotFoundError(key)
        # nothing here outlives the test: no copy is waited for until it is on the disk
        path = self._copies / key
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self._blobs[key])
        return path

    def size(self, key: str) -> int:
        """Give the number of bytes of a blob. FileNotFoundError when absent."""
        if key not in self._blobs:
            raise FileNotFoundError(key)
        return len(self._blobs[key])

    def exists(self, key: str) -> bool:
        """Tell whether the key is stored."""
        return checked_key(key) in self._blobs

    def keys(self, prefix: str) -> Sequence[str]:
        """List the keys under a prefix."""
        return sorted(key for key in self._blobs if key.startswith(prefix))

    def total(self, prefix: str) -> int:
        """Sum up the bytes of all blobs under a prefix."""
        return sum(len(self._blobs[key]) for key in self.keys(prefix))

    def unchanged_since(self, prefix: str, moment: datetime) -> Sequence[str]:
        """List the keys under a prefix that were last written before a moment."""
        return [key for key in self.keys(prefix) if self._written[key] < moment]

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove unfinished blobs: here there are none."""
        return self._files.remove_abandoned(moment)

    def delete_prefix(self, prefix: str) -> None:
        """Remove a blob, or all in a folder; nothing happens when there is nothing."""
        for key in (*self.keys(f"{checked_key(prefix).rstrip('/')}/"), prefix):
            self._blobs.pop(key, None)

    def scratch(self) -> Path:
        """Give a new empty directory; the caller removes it."""
        return self._files.scratch()


class MemoryQueue:
    """Tell what the test asked for."""

    def __init__(self, workers: int = 1, figures: StepFigures = NO_STEPS) -> None:
        self._workers = workers
        self._figures = figures

    def live_workers(self) -> int:
        """Give the number of workers."""
        return self._workers

    def figures(self) -> StepFigures:
        """Give the figures."""
        return self._figures
