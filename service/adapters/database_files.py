"""Files in the metadata database (SQLite or PostgreSQL)."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict

import sqlalchemy as sa

from service.adapters.database_tables import files
from service.ports import StoredFile


class DatabaseFileStore:
    """Keep the metadata of files.

    What is stored once for several files is added and removed in transactions that exclude each other: on SQLite every
    writing transaction does, on PostgreSQL a lock on the content's hash.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def add(self, file: StoredFile, place: Callable[[], None] = lambda: None) -> None:
        """Insert; `place` puts the content where it belongs, in the same transaction."""
        row = {**asdict(file), "scans": list(file.scans), "photos": list(file.photos)}
        with self._alone(file.sha256) as connection:
            place()
            connection.execute(sa.insert(files).values(row))

    def get(self, file_id: str) -> StoredFile | None:
        """Fetch."""
        with self._reading() as connection:
            row = connection.execute(sa.select(files).where(files.c.id == file_id)).mappings().one_or_none()
        return None if row is None else _file(row)

    def find(self, limit: int, offset: int) -> tuple[Sequence[StoredFile], int]:
        """List, newest first, with the number of all."""
        query = sa.select(files).order_by(files.c.created.desc(), files.c.id.desc()).limit(limit).offset(offset)
        with self._reading() as connection:
            number = connection.execute(sa.select(sa.func.count()).select_from(files)).scalar_one()
            rows = connection.execute(query).mappings().all()
        return [_file(row) for row in rows], number

    def contents(self) -> frozenset[str]:
        """Give the hashes of all contents that files have."""
        with self._reading() as connection:
            return frozenset(connection.execute(sa.select(files.c.sha256).distinct()).scalars())

    def delete(self, file_id: str) -> bool:
        """Forget; False when it was unknown."""
        with self._engine.begin() as connection:
            return bool(connection.execute(sa.delete(files).where(files.c.id == file_id)).rowcount)

    def remove_unused(self, sha256: str, remove: Callable[[], None]) -> bool:
        """Call `remove` if no file has this content, while nobody can add one; tell whether it was called."""
        query = sa.select(sa.func.count()).select_from(files).where(files.c.sha256 == sha256)
        with self._alone(sha256) as connection:
            unused = connection.execute(query).scalar_one() == 0
            if unused:
                remove()
            return unused

    def forget_lost(self, sha256: str, is_there: Callable[[], bool]) -> int:
        """Forget the files of a content that is not there (any more); give their number."""
        with self._alone(sha256) as connection:
            if is_there():
                return 0
            return connection.execute(sa.delete(files).where(files.c.sha256 == sha256)).rowcount

    def _reading(self) -> AbstractContextManager[sa.Connection]:
        return self._engine.execution_options(reads_only=True).begin()

    @contextmanager
    def _alone(self, sha256: str) -> Iterator[sa.Connection]:
        """Begin a transaction that is the only one for this content."""
        with self._engine.begin() as connection:
            if self._engine.dialect.name == "postgresql":
                connection.execute(sa.select(sa.func.pg_advisory_xact_lock(sa.func.hashtextextended(sha256, 0))))
            yield connection


def _file(row: sa.RowMapping) -> StoredFile:
    return StoredFile(**{**row, "scans": tuple(row["scans"]), "photos": tuple(row["photos"])})
