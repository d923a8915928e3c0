"""The audit log in the metadata database (SQLite or PostgreSQL)."""

from collections.abc import Collection, Sequence
from dataclasses import asdict, fields
from datetime import datetime

import sqlalchemy as sa

from service.adapters.database.tables import audit
from service.ports import AuditEntry, AuditFilter


class DatabaseAuditLog:
    """Keep what was done.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def write(self, entry: AuditEntry) -> None:
        """Add."""
        with self._engine.begin() as connection:
            connection.execute(sa.insert(audit).values(asdict(entry)))

    def find(self, which: AuditFilter) -> tuple[Sequence[AuditEntry], int]:
        """List, newest first, with the number of all that match."""
        conditions: list[sa.ColumnElement[bool]] = [sa.true()]
        if which.key_id is not None:
            conditions.append(audit.c.key_id == which.key_id)
        if which.project is not None:
            conditions.append(audit.c.project == which.project)
        if which.since is not None:
            conditions.append(audit.c.time >= which.since)
        matching = sa.and_(*conditions)
        columns = [audit.c[field.name] for field in fields(AuditEntry)]
        query = sa.select(*columns).where(matching).order_by(audit.c.id.desc()).limit(which.limit).offset(which.offset)
        with self._engine.execution_options(reads_only=True).begin() as connection:
            number = connection.execute(sa.select(sa.func.count()).select_from(audit).where(matching)).scalar_one()
            return [AuditEntry(*row) for row in connection.execute(query)], number

    def number_of(self, project: str) -> int:
        """Count the entries of a project."""
        query = sa.select(sa.func.count()).select_from(audit).where(audit.c.project == project)
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return int(connection.execute(query).scalar_one())

    def forget_before(self, moment: datetime, statuses: Collection[int] | None = None) -> int:
        """Remove what is older, or only what was answered with one of these; give its number."""
        which = sa.true() if statuses is None else audit.c.status.in_(statuses)
        with self._engine.begin() as connection:
            return connection.execute(sa.delete(audit).where(audit.c.time < moment, which)).rowcount
