"""The log lines of jobs in the metadata database."""

from collections.abc import Sequence

import sqlalchemy as sa

from service.adapters.database.tables import job_log, jobs
from service.ports import LogLine, narrowed


class DatabaseJobLog:
    """Keep what happened to each job; it goes with the job.

    Parameters
    ----------
    engine
        From `connect`.
    owner
        Project whose jobs' log this is; None: that of all.
    """

    def __init__(self, engine: sa.Engine, owner: str | None = None) -> None:
        self._engine = engine
        self._owner = owner

    def of(self, owner: str) -> "DatabaseJobLog":
        """Give the log of the jobs of one project."""
        return DatabaseJobLog(self._engine, narrowed(self._owner, owner))

    def write(self, job_id: str, lines: Sequence[LogLine]) -> None:
        """Add lines to a job's log; nothing happens when the job is gone."""
        with self._engine.begin() as connection:
            job = sa.select(jobs.c.id).where(jobs.c.id == job_id, self._mine())
            if lines and connection.execute(job).scalar() is not None:
                rows = [{"job_id": job_id, "time": line.time, "level": line.level, "text": line.text} for line in lines]
                connection.execute(sa.insert(job_log), rows)

    def read(self, job_id: str, limit: int) -> Sequence[LogLine]:
        """Give the last lines of a job's log, in the order in which they were written."""
        query = (
            sa.select(job_log.c.time, job_log.c.level, job_log.c.text)
            .join(jobs, jobs.c.id == job_log.c.job_id)
            .where(job_log.c.job_id == job_id, self._mine())
            .order_by(job_log.c.id.desc())
            .limit(limit)
        )
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return [LogLine(*row) for row in reversed(connection.execute(query).all())]

    def _mine(self) -> sa.ColumnElement[bool]:
        return sa.true() if self._owner is None else jobs.c.owner == self._owner
