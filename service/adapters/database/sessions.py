"""Sessions of browsers in the metadata database (SQLite or PostgreSQL)."""

import secrets
from datetime import datetime

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from service.adapters.database.tables import ended_sessions, session_secret

SECRET_BYTES = 32


class DatabaseSessionStore:
    """Keep the secret of sessions, and those that were ended.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine
        self._reading = engine.execution_options(reads_only=True)

    def secret(self) -> bytes:
        """Give the random bytes with which sessions are sealed; of several processes that make them one wins."""
        known = sa.select(session_secret.c.value)
        with self._reading.begin() as connection:
            found = connection.execute(known).scalar_one_or_none()
        if found is None:
            with self._engine.begin() as connection:
                made = self._insert(session_secret).values(id=1, value=secrets.token_bytes(SECRET_BYTES))
                connection.execute(made.on_conflict_do_nothing())
                found = connection.execute(known).scalar_one()
        return bytes(found)

    def end(self, session_id: str, until: datetime) -> None:
        """Note that a session is over."""
        with self._engine.begin() as connection:
            entry = self._insert(ended_sessions).values(id=session_id, until=until)
            connection.execute(entry.on_conflict_do_nothing())

    def has_ended(self, session_id: str) -> bool:
        """Tell whether a session was ended."""
        query = sa.select(ended_sessions.c.id).where(ended_sessions.c.id == session_id)
        with self._reading.begin() as connection:
            return connection.execute(query).first() is not None

    def forget_before(self, moment: datetime) -> int:
        """Forget sessions that would have run out by then; give their number."""
        with self._engine.begin() as connection:
            return connection.execute(sa.delete(ended_sessions).where(ended_sessions.c.until < moment)).rowcount

    def _insert(self, table: sa.Table) -> postgresql.Insert | sqlite.Insert:
        return (postgresql.insert if self._engine.dialect.name == "postgresql" else sqlite.insert)(table)
