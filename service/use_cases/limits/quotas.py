"""How much one project may have."""

from collections.abc import Callable
from dataclasses import dataclass

from service.errors import QuotaExceededError
from service.names.feature_keys import features_of_project
from service.ports import (
    AuditLog,
    BlobStore,
    FileStore,
    IdempotencyStore,
    JobStore,
    StoredAmount,
    UnfinishedJobs,
    UploadStore,
)
from service.refusals import QuotaFullError
from service.settings import Settings
from service.use_cases.limits.free_space import require_free_space

ENTRY_BYTES = 300
"""Of one entry of the audit log, with its places in the indices."""


@dataclass(frozen=True)
class Belongings:
    """What a project stores."""

    files: FileStore
    jobs: JobStore
    uploads: UploadStore
    owner: str = ""
    """Project whose these are; empty: the default project, or all."""
    answers: IdempotencyStore | None = None
    audit: AuditLog | None = None

    def of(self, owner: str) -> "Belongings":
        """Give those of one project."""
        bound = (self.files.of(owner), self.jobs.of(owner), self.uploads.of(owner))
        return Belongings(*bound, owner, self.answers, self.audit)

    def besides_files(self) -> int:
        """Sum up the bytes of results, and those that uploads on their way will have."""
        return self.jobs.results_bytes() + self.uploads.promised_bytes()

    def records_bytes(self) -> int:
        """Sum up what the project has in the database and cannot be without bounds."""
        answers = 0 if self.answers is None else self.answers.kept_bytes(self.owner)
        entries = 0 if self.audit is None else self.audit.number_of(self.owner)
        return self.jobs.inputs_bytes() + answers + ENTRY_BYTES * entries

    def require_record(self, settings: Settings, coming_bytes: int) -> None:
        """Refuse what would be kept in the database when there is no room for it.

        Raises
        ------
        InsufficientStorageError
            The disk would be (nearly) full.
        QuotaFullError
            The project has too much there.
        """
        require_free_space(settings.data_dir, settings.min_free_bytes, coming_bytes)
        total = self.records_bytes() + coming_bytes
        if total > settings.max_project_records_bytes:
            raise QuotaFullError(
                "bytes of inputs, kept answers and audit in the database", total, settings.max_project_records_bytes
            )

    def require_upload(self, settings: Settings) -> None:
        """Refuse one more resumable upload when too many are not finished.

        Raises
        ------
        QuotaExceededError
            With their number.
        """
        begun = self.uploads.unfinished()
        if begun >= settings.max_project_uploads:
            raise QuotaExceededError(
                f"{begun} uploads of this project are begun or refused, the limit is {settings.max_project_uploads}; "
                "DELETE /uploads/{id} removes one"
            )

    def require_within(self, settings: Settings) -> None:
        """Refuse when the project has stored too much already.

        Raises
        ------
        QuotaFullError
            Its jobs left more results than there was room for.
        """
        total = self.files.amount().bytes + self.besides_files()
        if total > settings.max_project_bytes:
            raise QuotaFullError("bytes", total, settings.max_project_bytes)


def count_results(job_id: str, jobs: JobStore, files: FileStore, blobs: BlobStore) -> None:
    """Note how many bytes a job has stored: its results, and what it computed of its files and keeps for later jobs.

    The latter counts for the files, with which it is removed.
    """
    job = jobs.get(job_id)
    if job is None:
        return
    mine = files.of(job.owner)
    for sha256 in {file.sha256 for file in map(mine.get, job.file_ids) if file is not None}:
        mine.note_computed(sha256, blobs.total(f"{features_of_project(sha256, job.owner)}/"))
    jobs.note_results(job_id, blobs.total(f"jobs/{job_id}/"))


def admit_job(settings: Settings) -> Callable[[UnfinishedJobs], None]:
    """Give what lets one more job in.

    It raises `QuotaExceededError` when too many jobs wait or run already, of the project or of all.
    """

    def admit(unfinished: UnfinishedJobs) -> None:
        if unfinished.of_owner >= settings.max_project_jobs:
            raise QuotaExceededError(
                f"{unfinished.of_owner} jobs of this project wait or run already, the limit is "
                f"{settings.max_project_jobs}"
            )
        if unfinished.all >= settings.max_queued_jobs:
            raise QuotaExceededError(
                f"as many jobs as this service takes wait or run already: {settings.max_queued_jobs}"
            )

    return admit


def admit_file(settings: Settings, size: int, besides: int = 0) -> Callable[[StoredAmount], None]:
    """Give what lets one more file in.

    It raises `QuotaFullError` when the project would have too many files, or too many bytes with this one and with
    those that it has `besides` files.
    """

    def admit(stored: StoredAmount) -> None:
        if stored.files + 1 > settings.max_project_files:
            raise QuotaFullError("files", stored.files + 1, settings.max_project_files)
        total = stored.bytes + besides + size
        if total > settings.max_project_bytes:
            raise QuotaFullError("bytes", total, settings.max_project_bytes)

    return admit
