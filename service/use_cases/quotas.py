"""How much one project may have."""

from collections.abc import Callable
from dataclasses import dataclass

from service.errors import QuotaExceededError
from service.ports import BlobStore, FileStore, JobStore, StoredAmount, UnfinishedJobs, UploadStore
from service.refusals import QuotaFullError
from service.settings import Settings


@dataclass(frozen=True)
class Belongings:
    """What a project stores."""

    files: FileStore
    jobs: JobStore
    uploads: UploadStore
    owner: str = ""
    """Project whose these are; empty: the default project, or all."""

    def of(self, owner: str) -> "Belongings":
        """Give those of one project."""
        return Belongings(self.files.of(owner), self.jobs.of(owner), self.uploads.of(owner), owner)

    def besides_files(self) -> int:
        """Sum up the bytes of results, and those that uploads on their way will have."""
        return self.jobs.results_bytes() + self.uploads.promised_bytes()

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


def count_results(job_id: str, jobs: JobStore, blobs: BlobStore) -> None:
    """Note how many bytes a job has stored."""
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
