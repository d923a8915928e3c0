"""Find jobs, their results and their downloads."""

import json
import mimetypes
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from service.errors import (
    ArtifactNotFoundError,
    JobDismissedError,
    NoSuchJobError,
    Problem,
    ResultNotReadyError,
    StorageError,
)
from service.names.identifiers import is_identifier
from service.ports import BlobStore, Job, JobState, JobStatus, JobStore, Json, JsonText

Kept = TypeVar("Kept")
MEDIA_TYPES = {".e57": "model/e57", ".ply": "application/octet-stream", ".dxf": "image/vnd.dxf"}


@dataclass(frozen=True)
class StoredArtifact:
    """One download of a job."""

    name: str
    media_type: str
    key: str
    bytes: int
    made: datetime


def find_job(job_id: str, jobs: JobStore) -> Job:
    """Fetch a job.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    """
    return _found(job_id, jobs.get)


def find_whole_job(job_id: str, jobs: JobStore) -> Job:
    """Fetch a job with its inputs.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    """
    return _found(job_id, jobs.whole)


def find_inputs(job_id: str, jobs: JobStore) -> JsonText:
    """Fetch the inputs of a job as they are kept.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    """
    return _found(job_id, jobs.inputs_text)


def _found(job_id: str, fetch: Callable[[str], Kept | None]) -> Kept:
    kept = fetch(job_id) if is_identifier(job_id) else None
    if kept is None:
        raise NoSuchJobError(job_id)
    return kept


async def look_at_job(job_id: str, jobs: JobStore) -> JobState:
    """Tell where a job stands.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    """
    state = await jobs.look(job_id) if is_identifier(job_id) else None
    if state is None:
        raise NoSuchJobError(job_id)
    return state


def find_result(job_id: str, jobs: JobStore, blobs: BlobStore) -> Path | Problem:
    """Find the result document of a job; a failed job has its problem document instead.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    ResultNotReadyError
        The job has not finished.
    JobDismissedError
        The job was dismissed.
    StorageError
        The job succeeded but its result is gone.
    """
    job = find_job(job_id, jobs)
    if job.status is JobStatus.FAILED:
        return job.problem or {"type": "about:blank", "title": "Job failed", "status": 500, "detail": job.message}
    if job.status is JobStatus.DISMISSED:
        raise JobDismissedError(job_id)
    if job.status is not JobStatus.SUCCESSFUL:
        raise ResultNotReadyError(job_id, job.status.value)
    try:
        return blobs.local_path(f"jobs/{job_id}/result.json")
    except FileNotFoundError:
        raise StorageError(f"the result of job '{job_id}' is missing from the storage") from None


def wanted_outputs(result: Path, wanted: Json) -> Json:
    """Give of a result document what was wanted when the job was made: `service.ports.Job.wanted`.

    Of a large network the lists do not stand in it: where some of them were wanted, `lists` tells where they are.
    """
    document: Json = json.loads(result.read_bytes())
    if wanted["outputs"] is None:
        return document
    names = set(wanted["outputs"])
    found = {name: document[name] for name in wanted["outputs"] if name in document}
    lists = {name: each for name, each in document.get("lists", {}).items() if each["pointer"].split("/")[1] in names}
    return {**found, "lists": lists} if lists else found


def find_artifacts(job_id: str, jobs: JobStore, blobs: BlobStore) -> list[StoredArtifact]:
    """List the downloads of a job.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    """
    job = find_job(job_id, jobs)
    return [_artifact(job, key, blobs) for key in blobs.keys(_prefix(job))]


def find_artifact(job_id: str, name: str, jobs: JobStore, blobs: BlobStore) -> StoredArtifact:
    """Find one download of a job.

    Raises
    ------
    NoSuchJobError
        There is no such job.
    ArtifactNotFoundError
        The job has none of that name.
    """
    job = find_job(job_id, jobs)
    # chosen from what is stored: a name from outside never becomes a key
    for key in blobs.keys(_prefix(job)):
        if key.removeprefix(_prefix(job)) == name:
            return _artifact(job, key, blobs)
    raise ArtifactNotFoundError(job_id, name)


def _prefix(job: Job) -> str:
    return f"jobs/{job.id}/artifacts/"


def _artifact(job: Job, key: str, blobs: BlobStore) -> StoredArtifact:
    made = job.finished or job.created
    return StoredArtifact(key.removeprefix(_prefix(job)), _media_type(key), key, blobs.size(key), made)


def _media_type(key: str) -> str:
    suffix = Path(key).suffix.lower()
    return MEDIA_TYPES.get(suffix) or mimetypes.types_map.get(suffix, "application/octet-stream")
