"""Keys in the metadata database (SQLite or PostgreSQL)."""

from collections.abc import Sequence
from datetime import datetime

import sqlalchemy as sa

from service.adapters.database.tables import keys, lock_name
from service.ports import Key, Scope, StoredKey


class DatabaseKeyStore:
    """Keep keys.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine
        self._reading = engine.execution_options(reads_only=True)

    def known(self) -> bool:
        """Tell whether there is or was a key."""
        with self._reading.begin() as connection:
            return connection.execute(sa.select(keys.c.id).limit(1)).first() is not None

    def add(self, key: StoredKey) -> bool:
        """Enter a key; False when a key of its name opens something already."""
        known = key.key
        row = {
            "id": known.id,
            "name": known.name,
            "project": known.project,
            "scopes": sorted(known.scopes),
            "hash": key.hash,
            "created": known.created,
            "expires": known.expires,
        }
        of_its_name = sa.select(keys).where(keys.c.name == known.name)
        with self._engine.begin() as connection:
            lock_name(connection, "keys")
            rivals = connection.execute(of_its_name).mappings().all()
            if any(_key(rival).valid(known.created) for rival in rivals):
                return False
            connection.execute(sa.insert(keys).values(row))
            return True

    def get(self, key_id: str) -> StoredKey | None:
        """Fetch."""
        with self._reading.begin() as connection:
            row = connection.execute(sa.select(keys).where(keys.c.id == key_id)).mappings().one_or_none()
        return None if row is None else StoredKey(_key(row), row["hash"])

    def find(self, limit: int, offset: int) -> tuple[Sequence[Key], int]:
        """List, newest first, with the number of all."""
        query = sa.select(keys).order_by(keys.c.created.desc(), keys.c.id.desc()).limit(limit).offset(offset)
        with self._reading.begin() as connection:
            number = connection.execute(sa.select(sa.func.count()).select_from(keys)).scalar_one()
            return [_key(row) for row in connection.execute(query).mappings()], number

    def revoke(self, key_id: str, now: datetime) -> Key | None:
        """Revoke a key for good; the time of the first revocation stays."""
        with self._engine.begin() as connection:
            first = sa.update(keys).where(keys.c.id == key_id, keys.c.revoked.is_(None)).values(revoked=now)
            connection.execute(first)
            row = connection.execute(sa.select(keys).where(keys.c.id == key_id)).mappings().one_or_none()
        return None if row is None else _key(row)

    def touch(self, key_id: str, now: datetime) -> None:
        """Note that a key was used."""
        with self._engine.begin() as connection:
            connection.execute(sa.update(keys).where(keys.c.id == key_id).values(last_used=now))


def _key(row: sa.RowMapping) -> Key:
    return Key(
        id=row["id"],
        name=row["name"],
        project=row["project"],
        scopes=frozenset(Scope(scope) for scope in row["scopes"]),
        created=row["created"],
        expires=row["expires"],
        revoked=row["revoked"],
        last_used=row["last_used"],
    )
