"""Jobs, files, blobs and a queue in memory, for tests."""

import hashlib
import shutil
import tempfile
import threading
import weakref
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from service.adapters.local_files import LocalFiles, checked_key
from service.errors import FileTooLargeError
from service.ports import Job, JobFilter, JobStatus, Json, StoredFile


class MemoryJobStore:
    """Keep jobs in a dictionary.

    Parameters
    ----------
    enqueue
        Called with each new job; when it raises, the job is not kept.
    """

    def __init__(self, enqueue: Callable[[Job], None] = lambda _job: None) -> None:
        self._jobs: dict[str, Job] = {}
        self._enqueue = enqueue
        self._lock = threading.RLock()

    def create_and_enqueue(self, job: Job) -> None:
        """Insert the job and put it on the queue: both or neither."""
        with self._lock:
            self._enqueue(job)
            self._jobs[job.id] = job

    def get(self, job_id: str) -> Job | None:
        """Fetch a job."""
        return self._jobs.get(job_id)

    def find(self, which: JobFilter) -> tuple[Sequence[Job], int]:
        """List jobs, newest first, and the number of all that match."""
        with self._lock:
            found = [
                job
                for job in self._jobs.values()
                if (not which.statuses or job.status in which.statuses)
                and (not which.process_ids or job.process_id in which.process_ids)
            ]
        found.sort(key=lambda job: (job.created, job.id), reverse=True)
        return found[which.offset : which.offset + which.limit], len(found)

    def start(self, job_id: str, now: datetime) -> Job | None:
        """Mark as running and count the attempt; None when the job is gone or final."""
        with self._lock:
            job = self._jobs.get(job_id)
            if job is None:
                return None
            started = job.started or now
            return self._change(
                job_id, status=JobStatus.RUNNING, attempts=job.attempts + 1, started=started, updated=now
            )

    def report(self, job_id: str, progress: int, message: str, now: datetime) -> bool:
        """Record progress, which never goes back; False when the job is gone or final."""
        with self._lock:
            job = self._jobs.get(job_id)
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
            if job_id in self._jobs and self._jobs[job_id].status.finished:
                del self._jobs[job_id]

    def unfinished_using(self, file_id: str) -> Job | None:
        """Find an unfinished job that reads a file."""
        with self._lock:
            users = (job for job in self._jobs.values() if file_id in job.file_ids and not job.status.finished)
            return next(users, None)

    def _change(self, job_id: str, **values: Any) -> Job | None:
        with self._lock:
            job = self._jobs.get(job_id)
            if job is None or job.status.finished:
                return None
            self._jobs[job_id] = replace(job, **values)
            return self._jobs[job_id]


class MemoryFileStore:
    """Keep the metadata of files in a dictionary."""

    def __init__(self) -> None:
        self._files: dict[str, StoredFile] = {}

    def add(self, file: StoredFile) -> None:
        """Insert."""
        self._files[file.id] = file

    def get(self, file_id: str) -> StoredFile | None:
        """Fetch."""
        return self._files.get(file_id)

    def find(self, limit: int, offset: int) -> tuple[Sequence[StoredFile], int]:
        """List, newest first, with the number of all."""
        found = sorted(self._files.values(), key=lambda file: (file.created, file.id), reverse=True)
        return found[offset : offset + limit], len(found)

    def count_with_content(self, sha256: str) -> int:
        """Count the files with this content."""
        return sum(file.sha256 == sha256 for file in self._files.values())

    def delete(self, file_id: str) -> bool:
        """Forget; False when it was unknown."""
        return self._files.pop(file_id, None) is not None


class MemoryBlobStore:
    """Keep blobs in a dictionary; `local_path` and `scratch` use a temporary directory that ends with the store."""

    def __init__(self) -> None:
        self._blobs: dict[str, bytes] = {}
        directory = tempfile.mkdtemp(prefix="tieline-memory-")
        weakref.finalize(self, shutil.rmtree, directory, ignore_errors=True)
        self._files = LocalFiles(Path(directory))

    async def write_stream(self, key: str, chunks: AsyncIterator[bytes], max_bytes: int) -> tuple[int, str]:
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

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store."""
        self.write_bytes(key, path.read_bytes())
        path.unlink()

    def local_path(self, key: str) -> Path:
        """Give a local copy of a blob. FileNotFoundError when absent."""
        if key not in self._blobs:
            raise FileNotFoundError(key)
        self._files.write_bytes(key, self._blobs[key])
        return self._files.local_path(key)

    def exists(self, key: str) -> bool:
        """Tell whether the key is stored."""
        return checked_key(key) in self._blobs

    def keys(self, prefix: str) -> Sequence[str]:
        """List the keys under a prefix."""
        return sorted(key for key in self._blobs if key.startswith(prefix))

    def delete_prefix(self, prefix: str) -> None:
        """Remove everything under a prefix; nothing happens when there is nothing."""
        for key in self.keys(checked_key(prefix)):
            del self._blobs[key]

    def scratch(self) -> Path:
        """Give a new empty directory; the caller removes it."""
        return self._files.scratch()


class MemoryQueue:
    """Remember what was cancelled."""

    def __init__(self, workers: int = 1) -> None:
        self.cancelled: list[str] = []
        self._workers = workers

    def cancel(self, job_id: str) -> None:
        """Note the wish."""
        self.cancelled.append(job_id)

    def live_workers(self) -> int:
        """Give the number the test asked for."""
        return self._workers
