"""First answers to repeated requests in the metadata database (SQLite or PostgreSQL)."""

from datetime import datetime
from typing import Any

import sqlalchemy as sa

from service.adapters.database.executors import clock
from service.adapters.database.tables import idempotency, lock_name
from service.names.identifiers import new_identifier
from service.ports import KEPT_ANSWERS, Answer, Claim

ROW_BYTES = 500
"""Of a request besides the body of its answer."""


class DatabaseIdempotencyStore:
    """Keep first answers.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def claim(self, owner: str, key: str, holder: str, now: datetime, seconds: float) -> Claim:
        """Begin a request, or find out that it was begun."""
        this = sa.and_(idempotency.c.owner == owner, idempotency.c.key == key)
        with self._engine.begin() as connection:
            moment = clock(connection)
            held_until = moment + seconds
            lock_name(connection, f"request {key} of {owner}")
            connection.execute(sa.delete(idempotency).where(this, idempotency.c.created < now - KEPT_ANSWERS))
            row = connection.execute(sa.select(idempotency).where(this)).mappings().one_or_none()
            if row is None:
                seed = new_identifier()
                begun = {"owner": owner, "key": key, "created": now, "seed": seed}
                connection.execute(sa.insert(idempotency).values(**begun, holder=holder, held_until=held_until))
                return Claim(True, seed, None, None)
            if row["status"] is not None:
                headers = [(name, value) for name, value in row["headers"]]
                return Claim(False, row["seed"], row["fingerprint"], Answer(row["status"], headers, row["body"]))
            mine = row["held_until"] < moment
            if mine:
                connection.execute(sa.update(idempotency).where(this).values(holder=holder, held_until=held_until))
            return Claim(mine, row["seed"], row["fingerprint"], None)

    def hold(self, owner: str, key: str, holder: str, seconds: float) -> None:
        """Go on holding a request."""
        with self._engine.begin() as connection:
            change = sa.update(idempotency).where(_held(owner, key, holder))
            connection.execute(change.values(held_until=clock(connection) + seconds))

    def note_fingerprint(self, owner: str, key: str, holder: str, fingerprint: str) -> None:
        """Keep what the content of a request was."""
        self._change(owner, key, holder, fingerprint=fingerprint)

    def keep_answer(self, owner: str, key: str, holder: str, answer: Answer) -> None:
        """Keep the answer to a request."""
        headers = [list(header) for header in answer.headers]
        self._change(owner, key, holder, status=answer.status, headers=headers, body=answer.body)

    def forget(self, owner: str, key: str, holder: str) -> None:
        """Forget a request that was refused and left nothing behind."""
        with self._engine.begin() as connection:
            connection.execute(sa.delete(idempotency).where(_held(owner, key, holder)))

    def let_go(self, owner: str, key: str, holder: str) -> None:
        """Let a request that broke off be tried again."""
        self._change(owner, key, holder, held_until=0.0)

    def kept_bytes(self, owner: str) -> int:
        """Sum up what is kept of the requests of a project."""
        size = sa.func.coalesce(sa.func.length(idempotency.c.body), 0) + ROW_BYTES
        query = sa.select(sa.func.coalesce(sa.func.sum(size), 0)).where(idempotency.c.owner == owner)
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return int(connection.execute(query).scalar_one())

    def forget_before(self, moment: datetime) -> int:
        """Remove what is older; give its number."""
        with self._engine.begin() as connection:
            return connection.execute(sa.delete(idempotency).where(idempotency.c.created < moment)).rowcount

    def _change(self, owner: str, key: str, holder: str, **values: Any) -> None:
        with self._engine.begin() as connection:
            connection.execute(sa.update(idempotency).where(_held(owner, key, holder)).values(values))


def _held(owner: str, key: str, holder: str) -> sa.ColumnElement[bool]:
    return sa.and_(idempotency.c.owner == owner, idempotency.c.key == key, idempotency.c.holder == holder)
