"""Find out whether jobs can be taken and run now."""

import asyncio
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

import structlog

from algorithms.scans.open3d_loading import missing_for_open3d
from schemas.resources.health import Check, Readiness
from service.errors import ServiceError
from service.names.identifiers import new_identifier
from service.ports import BlobStore, JobFilter, JobStore, Queue

log = structlog.get_logger()
ANSWERS_WITHIN_S = 5.0
"""Longer than database, storage and workers take together when they are well [s]."""
NEEDING_OPEN3D = "meshes and smoothed clouds"
PROBES = "probes/"
"""Where it is tried whether the storage can be written to."""


class ReadinessWatch:
    """Look once for all who ask within a time: anybody may ask, as often as he likes.

    Parameters
    ----------
    look
        Finds out; may take long.
    look_again_s
        For how long the answer is good.
    """

    def __init__(self, look: Callable[[], Readiness], look_again_s: float) -> None:
        self._look = look
        self._look_again_s = look_again_s
        self._found: Readiness | None = None
        self._until = 0.0
        self._looking: asyncio.Task[Readiness] | None = None

    async def readiness(self) -> Readiness:
        """Tell what was found last, or look."""
        if self._found is not None and time.monotonic() < self._until:
            return self._found
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(asyncio.to_thread(self._look))
        looking = self._looking
        self._found = await asyncio.shield(looking)
        self._until = time.monotonic() + self._look_again_s
        return self._found


def check_readiness(jobs: JobStore, blobs: BlobStore, queue: Queue, confinement: str = "") -> Readiness:
    """Try the database and the storage, and count the workers; tell how computations are confined.

    A library without which some processes cannot run is named; all others run, so the service is ready all the same.
    """
    looks: Mapping[str, Callable[[], Check]] = {
        "database": partial(_database, jobs),
        "storage": partial(_storage, blobs),
        "workers": partial(_workers, queue),
    }
    with _unwaited(ThreadPoolExecutor(len(looks), thread_name_prefix="readiness")) as threads:
        asked = {name: threads.submit(look) for name, look in looks.items()}
        until = time.monotonic() + ANSWERS_WITHIN_S
        checks = {name: _checked(name, found, until) for name, found in asked.items()}
    if confinement:
        checks["confinement"] = Check(ok=True, detail=confinement)
    ready = all(check.ok for check in checks.values())
    if (missing := missing_for_open3d()) is not None:
        checks["open3d"] = Check(ok=False, detail=f"{missing} ({NEEDING_OPEN3D} cannot be computed until then)")
    return Readiness(status="ready" if ready else "not-ready", checks=checks)


@contextmanager
def _unwaited(threads: ThreadPoolExecutor) -> Iterator[ThreadPoolExecutor]:
    """Leave threads behind that still wait for an answer: they end by the limits of what they ask."""
    try:
        yield threads
    finally:
        threads.shutdown(wait=False, cancel_futures=True)


def _checked(name: str, asked: "Future[Check]", until: float) -> Check:
    try:
        return asked.result(max(0.0, until - time.monotonic()))
    except TimeoutError:
        log.warning("no answer in time", what=name, within_s=ANSWERS_WITHIN_S)
        return Check(ok=False, detail=f"does not answer within {ANSWERS_WITHIN_S:g} s")
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
