"""Jobs in the metadata database (SQLite or PostgreSQL)."""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from service.adapters.database.callbacks import note_change
from service.adapters.database.given import gives, offer_job, offer_next_job, withdraw
from service.adapters.database.job_filter import condition_of
from service.adapters.database.job_states import DatabaseJobStates
from service.adapters.database.tables import connect, job_files, job_steps, jobs, lock_name
from service.adapters.database.totals import add_to_totals
from service.ports import Job, JobFilter, JobState, JobStatus, Json, JsonText, UnfinishedJobs, admit_any, narrowed
from service.settings import Settings

UNFINISHED = tuple(status.value for status in JobStatus if not status.finished)
INCREMENTAL = 2
"""Of SQLite's ways to give space back: when asked."""
PAGES_AT_ONCE = 25_000
"""100 MB, in which no other process can write."""
COLUMNS = tuple(each.name for each in fields(Job) if each.name not in {"file_ids", "status", "fetches", "inputs"})
# of a large network they are tens of megabytes, which only those pay for who need them
ALL_BUT_INPUTS = tuple(column for column in jobs.c if column.name != "inputs")
# clients ask for single jobs again and again: putting a statement together takes longer than executing it
JOB = sa.select(*ALL_BUT_INPUTS).where(jobs.c.id == sa.bindparam("id"))
WHOLE_JOB = sa.select(jobs).where(jobs.c.id == sa.bindparam("id"))
FILES_OF_JOB = (
    sa.select(job_files.c.file_id).where(job_files.c.job_id == sa.bindparam("id")).order_by(job_files.c.position)
)


def migrate(settings: Settings) -> None:
    """Bring the tables up to date; run once before any process of the service starts."""
    # imported here because only the launcher migrates
    import alembic.command
    import alembic.config

    engine = connect(settings, lasting=True)
    configuration = alembic.config.Config()
    folder = Path(__file__).parent / "migrations"
    configuration.set_main_option("script_location", str(folder).replace("%", "%%"))
    try:
        with engine.begin() as connection:
            if engine.dialect.name == "postgresql":
                # two machines may start at the same time; SQLite's BEGIN IMMEDIATE already excludes the other
                connection.execute(sa.select(sa.func.pg_advisory_xact_lock(7_166_201)))
            configuration.attributes["connection"] = connection
            alembic.command.upgrade(configuration, "head")
    finally:
        engine.dispose()


def let_shrink(settings: Settings) -> None:
    """Let the file of an embedded database give back what is deleted; once, while nobody else uses it."""
    engine = connect(settings)
    try:
        if engine.dialect.name == "sqlite":
            connection = engine.raw_connection()
            try:
                cursor = connection.cursor()
                if cursor.execute("PRAGMA auto_vacuum").fetchone()[0] != INCREMENTAL:
                    cursor.execute(f"PRAGMA auto_vacuum={INCREMENTAL}")
                    cursor.execute("VACUUM")
            finally:
                connection.close()
    finally:
        engine.dispose()


def give_space_back(engine: sa.Engine) -> None:
    """Let the embedded database's files become as small as what they hold; servers see to that themselves."""
    if engine.dialect.name != "sqlite":
        return
    connection = engine.raw_connection()
    try:
        cursor = connection.cursor()
        # as a script, because a statement would stop after each page
        cursor.executescript(f"PRAGMA incremental_vacuum({PAGES_AT_ONCE})")
        cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
    finally:
        connection.close()


def _reading(engine: sa.Engine) -> Any:
    return engine.execution_options(reads_only=True).begin()


class DatabaseJobStore:
    """Keep jobs. One that is kept is on the queue (`service.adapters.database.steps`).

    Parameters
    ----------
    engine
        From `connect`.
    owner
        Project whose jobs these are; None: those of all.
    states
        Of the same database; None: made anew.
    """

    def __init__(self, engine: sa.Engine, owner: str | None = None, states: DatabaseJobStates | None = None) -> None:
        self._engine = engine
        self._states = states or DatabaseJobStates(engine)
        self._owner = owner
        self._mine = sa.true() if owner is None else jobs.c.owner == owner

    def of(self, owner: str) -> "DatabaseJobStore":
        """Give the jobs of one project."""
        return DatabaseJobStore(self._engine, narrowed(self._owner, owner), self._states)

    def create_and_enqueue(
        self,
        job: Job,
        admit: Callable[[UnfinishedJobs], None] = admit_any,
        inputs: JsonText | None = None,
        total_weight: float = 0.0,
    ) -> None:
        """Insert the job, which puts it on the queue, in one transaction, in which `admit` is asked."""
        if self._owner is not None:
            job = replace(job, owner=self._owner)
        row = asdict(replace(job, inputs={}))
        row.pop("file_ids")
        row["status"] = job.status.value
        row["inputs"] = JsonText(json.dumps(job.inputs)) if inputs is None else inputs
        row["input_bytes"] = len(row["inputs"])
        row["total_weight"] = total_weight
        with self._engine.begin() as connection:
            lock_name(connection, f"jobs of {job.owner}")
            admit(_unfinished(connection, job.owner))
            connection.execute(sa.insert(jobs).values(row))
            if job.file_ids:
                connection.execute(
                    sa.insert(job_files),
                    [{"job_id": job.id, "position": i, "file_id": f} for i, f in enumerate(job.file_ids)],
                )
            if gives(connection):
                offer_job(connection, job.id)

    def get(self, job_id: str) -> Job | None:
        """Fetch a job without its inputs."""
        with _reading(self._engine) as connection:
            return self._job(connection, job_id)

    def whole(self, job_id: str) -> Job | None:
        """Fetch a job with its inputs."""
        with _reading(self._engine) as connection:
            return self._job(connection, job_id, WHOLE_JOB)

    def inputs_text(self, job_id: str) -> JsonText | None:
        """Fetch the inputs of a job as they are kept."""
        query = sa.select(sa.cast(jobs.c.inputs, sa.Text)).where(jobs.c.id == job_id, self._mine)
        with _reading(self._engine) as connection:
            text = connection.execute(query).scalar()
        return None if text is None else JsonText(text)

    async def look(self, job_id: str) -> JobState | None:
        """Tell where a job stands."""
        return await self._states.look(job_id, self._owner)

    def find(self, which: JobFilter) -> tuple[Sequence[Job], int]:
        """List jobs, newest first, and the number of all that match."""
        condition = sa.and_(self._mine, condition_of(which))
        query = sa.select(*ALL_BUT_INPUTS).where(condition).order_by(jobs.c.created.desc(), jobs.c.id.desc())
        with _reading(self._engine) as connection:
            number = connection.execute(sa.select(sa.func.count()).select_from(jobs).where(condition)).scalar_one()
            rows = connection.execute(query.limit(which.limit).offset(which.offset)).mappings().all()
            return self._with_files(connection, rows), number

    def start(self, job_id: str, now: datetime) -> Job | None:
        """Mark as running and count the attempt; None when the job is gone or final."""
        return self._change(
            job_id,
            status=JobStatus.RUNNING.value,
            attempts=jobs.c.attempts + 1,
            started=sa.func.coalesce(jobs.c.started, sa.literal(now, jobs.c.started.type)),
            updated=now,
        )

    def report(self, job_id: str, progress: int, message: str, now: datetime) -> bool:
        """Record progress, which never goes back; False when the job is gone or final."""
        return self._change(job_id, progress=_at_least(progress), message=message, updated=now) is not None

    def succeed(self, job_id: str, now: datetime) -> bool:
        """Mark as successful; False when it was final or gone."""
        final = {"status": JobStatus.SUCCESSFUL.value, "progress": 100, "message": "done"}
        return self._change(job_id, **final, updated=now, finished=now) is not None

    def fail(self, job_id: str, problem: Json, now: datetime) -> bool:
        """Mark as failed with its problem document."""
        message = str(problem.get("detail") or problem.get("title") or "failed")
        final = {"status": JobStatus.FAILED.value, "problem": problem, "message": message}
        return self._change(job_id, **final, updated=now, finished=now) is not None

    def dismiss(self, job_id: str, now: datetime) -> Job | None:
        """Mark a waiting or running job as dismissed; return the job as it is then."""
        final = {"status": JobStatus.DISMISSED.value, "message": "dismissed on request"}
        return self._change(job_id, **final, updated=now, finished=now) or self.get(job_id)

    def delete(self, job_id: str) -> None:
        """Forget a finished job; an unfinished one stays."""
        with self._engine.begin() as connection:
            connection.execute(sa.delete(jobs).where(jobs.c.id == job_id, jobs.c.status.not_in(UNFINISHED), self._mine))

    def note_results(self, job_id: str, size: int) -> None:
        """Note how many bytes are stored of a job."""
        with self._engine.begin() as connection:
            connection.execute(sa.update(jobs).where(jobs.c.id == job_id, self._mine).values(result_bytes=size))

    def results_bytes(self) -> int:
        """Sum up what was noted."""
        with _reading(self._engine) as connection:
            return int(connection.execute(sa.select(sa.func.sum(jobs.c.result_bytes)).where(self._mine)).scalar() or 0)

    def inputs_bytes(self) -> int:
        """Sum up the inputs of all jobs as they are kept."""
        with _reading(self._engine) as connection:
            return int(connection.execute(sa.select(sa.func.sum(jobs.c.input_bytes)).where(self._mine)).scalar() or 0)

    def uncounted(self, before: datetime, limit: int) -> Sequence[str]:
        """List jobs that ended before a moment and of whose results nothing was noted."""
        ended = sa.and_(jobs.c.result_bytes.is_(None), jobs.c.finished < before, self._mine)
        with _reading(self._engine) as connection:
            return list(connection.execute(sa.select(jobs.c.id).where(ended).limit(limit)).scalars())

    def unfinished_using(self, file_id: str) -> Job | None:
        """Find an unfinished job that reads a file."""
        query = (
            sa.select(jobs.c.id)
            .join(job_files, job_files.c.job_id == jobs.c.id)
            .where(job_files.c.file_id == file_id, jobs.c.status.in_(UNFINISHED), self._mine)
            .limit(1)
        )
        with _reading(self._engine) as connection:
            job_id = connection.execute(query).scalar()
            return None if job_id is None else self._job(connection, job_id)

    def _change(self, job_id: str, **values: Any) -> Job | None:
        """Change an unfinished job; None when it is gone or final, or of another project."""
        with self._engine.begin() as connection:
            return change_job(connection, job_id, self._mine, **values)

    def _job(self, connection: sa.Connection, job_id: str, statement: sa.Select[Any] = JOB) -> Job | None:
        row = connection.execute(statement, {"id": job_id}).mappings().one_or_none()
        if row is None or self._owner not in {None, row["owner"]}:
            return None
        return _job_of(row, connection.execute(FILES_OF_JOB, {"id": job_id}).scalars())

    @staticmethod
    def _with_files(connection: sa.Connection, rows: Sequence[sa.RowMapping]) -> list[Job]:
        wanted = [row["id"] for row in rows]
        query = sa.select(job_files).where(job_files.c.job_id.in_(wanted)).order_by(job_files.c.position)
        file_ids: dict[str, list[str]] = {job_id: [] for job_id in wanted}
        for row in connection.execute(query).mappings() if wanted else ():
            file_ids[row["job_id"]].append(row["file_id"])
        return [_job_of(row, file_ids[row["id"]]) for row in rows]


def change_job(
    connection: sa.Connection, job_id: str, condition: sa.ColumnElement[bool] | None = None, **values: Any
) -> Job | None:
    """Change an unfinished job; None when it is gone or final. The one place where status moves forward."""
    which = sa.and_(jobs.c.id == job_id, jobs.c.status.in_(UNFINISHED), sa.true() if condition is None else condition)
    change = sa.update(jobs).where(which).values(values).returning(*ALL_BUT_INPUTS)
    row = connection.execute(change).mappings().one_or_none()
    if row is None:
        return None
    job = _job_of(row, connection.execute(FILES_OF_JOB, {"id": job_id}).scalars())
    if "status" in values:
        note_change(connection, job)
    if job.status.finished:
        if gives(connection) and job.status is not JobStatus.SUCCESSFUL:
            withdraw(connection, job_id)
        # nobody is to begin what waits; what is computed is given up by who computes it
        waiting = sa.and_(job_steps.c.job_id == job_id, job_steps.c.state != "done")
        connection.execute(sa.delete(job_steps).where(waiting))
    if job.status is JobStatus.FAILED:
        kind = str((job.problem or {}).get("title") or "unknown")
        add_to_totals(connection, {("job_failures", kind): 1.0})
    if job.status.finished and gives(connection):
        offer_next_job(connection, job.owner)
    return job


def _job_of(row: sa.RowMapping, file_ids: Iterable[str]) -> Job:
    known = {name: row[name] for name in COLUMNS}
    known |= {"inputs": row.get("inputs", {}), "fetches": tuple(row["fetches"] or ())}  # inputs only where asked for
    return Job(**known, status=JobStatus(row["status"]), file_ids=tuple(file_ids))


def _unfinished(connection: sa.Connection, owner: str) -> UnfinishedJobs:
    of_owner = sa.func.coalesce(sa.func.sum(sa.case((jobs.c.owner == owner, 1), else_=0)), 0)
    query = sa.select(of_owner, sa.func.count()).where(jobs.c.status.in_(UNFINISHED))
    return UnfinishedJobs(*connection.execute(query).one())


def _at_least(progress: int) -> sa.ColumnElement[int]:
    """Let progress only grow."""
    return sa.case((jobs.c.progress < progress, progress), else_=jobs.c.progress)
