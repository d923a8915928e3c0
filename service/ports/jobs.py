"""What the service keeps of jobs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Protocol

from service.ports.documents import Json, JsonText

USUAL_URGENCY = 3


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
    """Validated inputs as in the request; only `JobStore.whole` reads them, elsewhere they are empty."""
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
    owner: str = ""
    """Project that the job belongs to; empty: the default project."""
    urgency: int = USUAL_URGENCY
    """0 (first) to 7 (last), as in RFC 9218."""
    request_id: str = ""
    """Correlation id of the request that made it."""
    wanted: Json | None = None
    """Which outputs are wanted and how: ``{"outputs": names or null (all), "raw": bool}``; None: all as a document.
    Where some of them are files, ``files`` says how each is wanted."""
    subscriber: Json | None = None
    """Who is told how it goes: `service.ports.Subscription` as JSON."""
    fetches: tuple[Json, ...] = ()
    """What it fetches before anything else: id of the file that each becomes, address, place in the request."""


@dataclass(frozen=True)
class JobState:
    """Where a job stands, which clients ask again and again; the fields are those of `Job`."""

    id: str
    process_id: str
    status: JobStatus
    created: datetime
    started: datetime | None
    finished: datetime | None
    updated: datetime | None
    progress: int
    message: str
    attempts: int


@dataclass(frozen=True)
class JobFilter:
    """Which jobs to list."""

    statuses: tuple[JobStatus, ...] = ()
    process_ids: tuple[str, ...] = ()
    limit: int = 100
    offset: int = 0
    created_from: datetime | None = None
    """Created then or later."""
    created_before: datetime | None = None
    """Created earlier."""
    min_duration_s: float | None = None
    """Have run, or run already, at least so long."""
    max_duration_s: float | None = None
    """Have run, or run already, at most so long."""
    now: datetime | None = None
    """Until when jobs that still run have run; given with a duration."""

    @property
    def asks_for_duration(self) -> bool:
        """Tell whether only jobs match that have begun."""
        return self.min_duration_s is not None or self.max_duration_s is not None

    def admits(self, job: Job) -> bool:
        """Tell whether a job matches, whatever page it is on."""
        if self.statuses and job.status not in self.statuses:
            return False
        if self.process_ids and job.process_id not in self.process_ids:
            return False
        if self.created_from is not None and job.created < self.created_from:
            return False
        if self.created_before is not None and job.created >= self.created_before:
            return False
        return not self.asks_for_duration or self._lasts(job)

    def _lasts(self, job: Job) -> bool:
        end = job.finished or self.now
        if job.started is None or end is None:
            return False
        duration_s = (end - job.started).total_seconds()
        least_s = 0.0 if self.min_duration_s is None else self.min_duration_s
        return least_s <= duration_s <= (duration_s if self.max_duration_s is None else self.max_duration_s)


@dataclass(frozen=True)
class UnfinishedJobs:
    """How many jobs have not finished."""

    of_owner: int
    """Those of one project."""
    all: int


def admit_any(_unfinished: UnfinishedJobs) -> None:
    """Let a job in, whatever waits already."""


class JobStore(Protocol):
    """Keep jobs. Every method is one transaction. Status only moves forward: a final status never changes."""

    def of(self, owner: str) -> "JobStore":
        """Give the jobs of one project: those of others do not exist there, and new ones belong to it.

        PermissionError when this store is another project's.
        """

    def create_and_enqueue(
        self,
        job: Job,
        admit: Callable[[UnfinishedJobs], None] = admit_any,
        inputs: JsonText | None = None,
        total_weight: float = 0.0,
    ) -> None:
        """Insert the job and put it on the queue in one transaction: both or neither.

        Inputs that another process has written are given as their text, in place of those of the job. `admit` sees
        what is unfinished before; when it raises, the job is not kept. Nobody else creates a job of the same project
        meanwhile. `total_weight` estimates how much it takes, 0: unknown.
        """

    def get(self, job_id: str) -> Job | None:
        """Fetch a job without its inputs, which may be tens of megabytes."""

    def whole(self, job_id: str) -> Job | None:
        """Fetch a job with its inputs."""

    def inputs_text(self, job_id: str) -> JsonText | None:
        """Fetch the inputs of a job as they are kept, without reading them."""

    async def look(self, job_id: str) -> JobState | None:
        """Tell where a job stands, as quickly as possible; the event loop is not held up by a store that is slow."""

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

    def note_results(self, job_id: str, size: int) -> None:
        """Note how many bytes are stored of a job: its result, downloads and what lies between."""

    def results_bytes(self) -> int:
        """Sum up what was noted."""

    def inputs_bytes(self) -> int:
        """Sum up the inputs of all jobs as they are kept."""

    def uncounted(self, before: datetime, limit: int) -> Sequence[str]:
        """List jobs that ended before a moment and of whose results nothing was noted."""

    def unfinished_using(self, file_id: str) -> Job | None:
        """Find an unfinished job that reads a file."""


@dataclass(frozen=True)
class LogLine:
    """One line of a job's log."""

    time: datetime
    level: str
    """info, warning or error."""
    text: str


class JobLog(Protocol):
    """Keep what happened to each job; it goes with the job."""

    def of(self, owner: str) -> "JobLog":
        """Give the log of the jobs of one project. PermissionError when this log is another project's."""

    def write(self, job_id: str, lines: Sequence[LogLine]) -> None:
        """Add lines to a job's log; nothing happens when the job is gone."""

    def read(self, job_id: str, limit: int) -> Sequence[LogLine]:
        """Give the last lines of a job's log, in the order in which they were written."""
