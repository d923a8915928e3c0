"""Find out whether jobs can be taken and run now."""

from collections.abc import Callable

from schemas.health import Check, Readiness
from service.errors import ServiceError
from service.ports import BlobStore, JobFilter, JobStore, Queue
from service.use_cases.identifiers import new_identifier

PROBES = "probes/"
"""Where it is tried whether the storage can be written to."""


def check_readiness(jobs: JobStore, blobs: BlobStore, queue: Queue) -> Readiness:
    """Try the database and the storage, and count the workers."""
    checks = {
        "database": _checked(lambda: _database(jobs)),
        "storage": _checked(lambda: _storage(blobs)),
        "workers": _checked(lambda: _workers(queue)),
    }
    ready = all(check.ok for check in checks.values())
    return Readiness(status="ready" if ready else "not-ready", checks=checks)


def _checked(check: Callable[[], Check]) -> Check:
    try:
        return check()
    except (ServiceError, OSError) as error:
        return Check(ok=False, detail=str(error))


def _database(jobs: JobStore) -> Check:
    jobs.find(JobFilter(limit=1))
    return Check(ok=True, detail="answers")  # not how many there are: anybody may ask


def _storage(blobs: BlobStore) -> Check:
    key = f"{PROBES}{new_identifier()}"
    blobs.write_bytes(key, b"written to see whether it can be")
    blobs.delete_prefix(key)
    return Check(ok=True, detail="writable")


def _workers(queue: Queue) -> Check:
    workers = queue.live_workers()
    return Check(ok=workers > 0, detail=f"{workers} alive")
