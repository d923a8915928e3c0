"""How much one project may have."""

from collections.abc import Callable

from service.errors import QuotaExceededError
from service.ports import StoredAmount, UnfinishedJobs
from service.refusals import QuotaFullError
from service.settings import Settings


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


def admit_file(settings: Settings, size: int, under_way: int = 0) -> Callable[[StoredAmount], None]:
    """Give what lets one more file in.

    It raises `QuotaFullError` when the project would have too many files, or too many bytes with this one and with
    those `under_way`.
    """

    def admit(stored: StoredAmount) -> None:
        if stored.files + 1 > settings.max_project_files:
            raise QuotaFullError("files", stored.files + 1, settings.max_project_files)
        total = stored.bytes + under_way + size
        if total > settings.max_project_bytes:
            raise QuotaFullError("bytes", total, settings.max_project_bytes)

    return admit
