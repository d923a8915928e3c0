"""The steps in which a job gets the files that it was promised: fetched, inspected, entered, checked."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from service.errors import ComputationFailedError, NoSuchJobError, ServiceError, StorageError
from service.ports import Job, JobStore, Json, Process, StepFailedError, StepRunner, Stored
from service.refusals import BusyError
from service.use_cases.inputs.fetch_files import Fetch, pointed, with_pointers
from service.use_cases.inputs.validate_request import validated
from service.use_cases.uploads.store_files import FileIntake, Received

FETCH, CHECK = "fetch-file", "check-files"


@dataclass(frozen=True)
class FetchingRunner:
    """Run steps: those about files of other servers here, for what needs the database, all others where they belong.

    Bytes of strangers are received and read in processes of their own; this one only enters what they found.

    Parameters
    ----------
    runner
        Runs steps in processes of their own.
    intake
        Where files go.
    jobs
        All jobs.
    processes
        Whose jobs these are, by id.
    patience
        Calls functions of the stores, whose database may be away for a while.
    """

    runner: StepRunner
    intake: FileIntake
    jobs: JobStore
    processes: Mapping[str, Process[Any]]
    patience: Callable[..., Awaitable[Any]] = asyncio.to_thread

    async def run(
        self, step: str, arguments: Json, *, timeout_s: float, on_progress: Callable[[float, str], None] | None = None
    ) -> Json:
        """Give the step's output; see `service.ports.StepRunner`."""
        if step not in {FETCH, CHECK}:
            return await self.runner.run(step, arguments, timeout_s=timeout_s, on_progress=on_progress)
        fetches: tuple[Fetch, ...] = ()
        try:
            job = await self._job(arguments["job_id"])
            fetches = tuple(map(Fetch.from_json, job.fetches))
            if step == CHECK:
                return await self._checked(job)
            fetches = tuple(fetch for fetch in fetches if fetch.id == arguments["id"])
            return await self._fetched(job, fetches[0], timeout_s, on_progress)
        except (ComputationFailedError, StorageError, BusyError) as error:
            raise ComputationFailedError(str(error)) from error  # tried again
        except StepFailedError as error:
            raise StepFailedError(with_pointers(error.problem, fetches)) from None
        except ServiceError as error:
            raise StepFailedError(pointed(error, fetches)) from None

    async def _job(self, job_id: str) -> Job:
        job: Job | None = await self.patience(self.jobs.whole, job_id)
        if job is None:
            raise NoSuchJobError(job_id)
        return job

    async def _fetched(
        self, job: Job, fetch: Fetch, timeout_s: float, on_progress: Callable[[float, str], None] | None
    ) -> Json:
        """Fetch a file unless that was done before, though nobody heard of it; give what a plan sees of it."""
        intake = self.intake.of(job.owner)
        file = await self.patience(intake.files.get, fetch.id)
        if file is None:
            most = await self.patience(intake.room)
            received = Received(fetch.id, "")
            try:
                came = await self.runner.run(
                    FETCH,
                    {"id": fetch.id, "href": fetch.href, "max_bytes": most},
                    timeout_s=timeout_s,
                    on_progress=on_progress,
                )
                received = Received(fetch.id, came["name"], came["bytes"], came["sha256"])
                file = await intake.inspected(received, datetime.now(UTC), fetch.columns, wait_s=timeout_s)
                file = await self.patience(intake.enter, file)
            except BaseException:  # also where the job was dismissed just when the file had come
                intake.drop(received)
                raise
        return {"id": fetch.id, **file.summary()}

    async def _checked(self, job: Job) -> Json:
        """Check of the request what could not be known before the files were there."""
        intake = self.intake.of(job.owner)
        process = self.processes[job.process_id]
        inputs = validated(process.inputs, job.inputs, "/inputs")
        await self.patience(process.check, inputs, Stored(intake.files, self.jobs.of(job.owner), intake.settings))
        return {}
