"""Finish or remove what clients and killed processes have left half-done."""

import asyncio
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta

from service.errors import ServiceError
from service.names.content_keys import FILES, INCOMING, content_key, is_content
from service.names.feature_keys import FEATURES
from service.ports import BlobStore, FileStore, JobFilter, JobStore, UploadState
from service.use_cases.limits.check_readiness import PROBES
from service.use_cases.limits.quotas import count_results
from service.use_cases.uploads.receive_uploads import UploadDesk
from service.use_cases.uploads.store_files import release_content

JOBS = "jobs/"
ROOM_KEPT_FOR = timedelta(hours=1)
"""Since the last byte of an unfinished upload."""
SETTLED_AFTER = timedelta(minutes=1)
"""Computations of a job that was dismissed have stopped by then."""
COUNTED_AT_ONCE = 1000


@dataclass(frozen=True)
class CleanUp:
    """What was done."""

    uploads_finished: int = 0
    """Complete uploads whose process died before it made files of them."""
    uploads_expired: int = 0
    half_made: int = 0
    """Unfinished blobs, and files that had arrived and were never entered."""
    contents_removed: int = 0
    """Contents, and features of contents, that no file has."""
    files_forgotten: int = 0
    """Files whose content is gone."""
    jobs_removed: int = 0
    """Results and downloads of jobs that nobody knows."""
    jobs_counted: int = 0
    """Jobs that failed or were dismissed: what they left counts from now on for what their project stores."""

    @property
    def nothing(self) -> bool:
        """Tell whether all was in order."""
        return not any(asdict(self).values())


@dataclass(frozen=True)
class Cleaner:
    """Where there may be something to clean up.

    Any number of processes may clean up at any time, beside all that runs: what is decided by looking at files and
    rows is decided again where nobody else can change them. A database that knows nothing at all is taken for the
    wrong one, and an empty storage likewise: then nothing is removed on its word.
    """

    desk: UploadDesk
    jobs: JobStore

    async def clean_up(self, now: datetime) -> CleanUp:
        """Do it once."""
        moment = now - timedelta(seconds=self.desk.intake.settings.upload_expiry_s)
        finished = expired = 0
        for upload_id in await asyncio.to_thread(self.desk.uploads.ids):
            try:
                state = await asyncio.to_thread(self.desk.uploads.find, upload_id)
                if self.desk.expires(state) < now:
                    expired += await asyncio.to_thread(self._remove_upload, upload_id, now)
                elif _is_left(state):
                    await self.desk.finish(upload_id, now)
                    finished += 1
                elif now - state.touched > ROOM_KEPT_FOR:
                    await asyncio.to_thread(self._give_room_back, upload_id)
            except ServiceError:  # refused, which the upload itself tells, or removed meanwhile
                continue
        half_made = await asyncio.to_thread(self._remove_half_made, moment)
        contents, files = await asyncio.to_thread(self._match_contents)
        jobs = await asyncio.to_thread(self._remove_unknown_jobs, moment)
        counted = await asyncio.to_thread(self._count_results, now - SETTLED_AFTER)
        return CleanUp(finished, expired, half_made, contents, files, jobs, counted)

    @property
    def _files(self) -> FileStore:
        return self.desk.intake.files

    @property
    def _blobs(self) -> BlobStore:
        return self.desk.intake.blobs

    def _remove_upload(self, upload_id: str, now: datetime) -> bool:
        opened = self.desk.uploads.lock(upload_id)
        if opened is None:
            return False
        try:
            expired = self.desk.expires(opened.state) < now
            if expired:
                opened.remove()
            return expired
        finally:
            opened.close()

    def _give_room_back(self, upload_id: str) -> None:
        """Let others have the room of an upload that may never go on; when it does, room is looked for again."""
        opened = self.desk.uploads.lock(upload_id)
        if opened is not None:
            try:
                opened.give_room_back()
            finally:
                opened.close()

    def _remove_half_made(self, moment: datetime) -> int:
        return self.desk.uploads.remove_abandoned(moment) + remove_half_made(self._blobs, moment)

    def _match_contents(self) -> tuple[int, int]:
        """Remove contents without a file, and forget files without content."""
        stored = {name for name in map(_second, self._blobs.keys(FILES)) if is_content(name)}
        computed = {name for name in map(_second, self._blobs.keys(FEATURES)) if is_content(name)}
        known = self._files.contents()
        removed = forgotten = 0
        if known:
            removed = sum(release_content(name, self._files, self._blobs) for name in (stored | computed) - known)
        if stored:
            forgotten = sum(self._files.forget_lost(name, self._is_stored(name)) for name in known - stored)
        return removed, forgotten

    def _is_stored(self, sha256: str) -> Callable[[], bool]:
        return lambda: self._blobs.exists(content_key(sha256))

    def _remove_unknown_jobs(self, moment: datetime) -> int:
        _, known = self.jobs.find(JobFilter(limit=1))
        if not known:
            return 0
        old = {_second(key) for key in self._blobs.unchanged_since(JOBS, moment)}
        unknown = [job_id for job_id in old if self.jobs.get(job_id) is None]
        for job_id in unknown:
            self._blobs.delete_prefix(f"{JOBS}{job_id}/")
        return len(unknown)

    def _count_results(self, before: datetime) -> int:
        uncounted = self.jobs.uncounted(before, COUNTED_AT_ONCE)
        for job_id in uncounted:
            count_results(job_id, self.jobs, self._files, self._blobs)
        return len(uncounted)


def remove_half_made(blobs: BlobStore, moment: datetime) -> int:
    """Remove what arrived or began to arrive before a moment, and was never entered; give the number."""
    removed = blobs.remove_abandoned(moment)
    for key in (*blobs.unchanged_since(INCOMING, moment), *blobs.unchanged_since(PROBES, moment)):
        blobs.delete_prefix(key)
        removed += 1
    return removed


def _second(key: str) -> str:
    """Give the second part of a key, which is the name of a content or of a job."""
    return key.split("/")[1]


def _is_left(state: UploadState) -> bool:
    return state.complete and not state.upload.finished and state.upload.problem is None
