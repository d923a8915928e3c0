"""The log lines of jobs in the metadata database."""

from collections.abc import Sequence

import sqlalchemy as sa

from service.adapters.database_tables import job_log, jobs
from service.ports import LogLine


class DatabaseJobLog:
    """Keep what happened to each job; it goes with the job.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def write(self, job_id: str, lines: Sequence[LogLine]) -> None:
        """Add lines to a job's log; nothing happens when the job is gone."""
        with self._engine.begin() as connection:
            if lines and connection.execute(sa.select(jobs.c.id).where(jobs.c.id == job_id)).scalar() is not None:
                rows = [{"job_id": job_id, "time": line.time, "level": line.level, "text": line.text} for line in lines]
                connection.execute(sa.insert(job_log), rows)

    def read(self, job_id: str, limit: int) -> Sequence[LogLine]:
        """Give the last lines of a job's log, in the order in which they were written."""
        query = (
            sa.select(job_log.c.time, job_log.c.level, job_log.c.text)
            .where(job_log.c.job_id == job_id)
            .order_by(job_log.c.id.desc())
            .limit(limit)
        )
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return [LogLine(*row) for row in reversed(connection.execute(query).all())]
