"""Files in the metadata database (SQLite or PostgreSQL)."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, replace

import sqlalchemy as sa

from service.adapters.database.tables import files, lock_name
from service.ports import StoredAmount, StoredFile, admit_any_file, narrowed


class DatabaseFileStore:
    """Keep the metadata of files.

    What is stored once for several files is added and removed in transactions that exclude each other: on SQLite every
    writing transaction does, on PostgreSQL a lock on the content's hash.

    Parameters
    ----------
    engine
        From `connect`.
    owner
        Project whose files these are; None: those of all.
    """

    def __init__(self, engine: sa.Engine, owner: str | None = None) -> None:
        self._engine = engine
        self._owner = owner
        self._mine = sa.true() if owner is None else files.c.owner == owner

    def of(self, owner: str) -> "DatabaseFileStore":
        """Give the files of one project; contents are shared by all."""
        return DatabaseFileStore(self._engine, narrowed(self._owner, owner))

    def amount(self) -> StoredAmount:
        """Sum up the files."""
        with self._reading() as connection:
            return _amount(connection, self._mine)

    def add(
        self,
        file: StoredFile,
        place: Callable[[], None] = lambda: None,
        admit: Callable[[StoredAmount], None] = admit_any_file,
    ) -> StoredFile:
        """Insert; `place` puts the content where it belongs, in the same transaction, in which `admit` is asked."""
        owner = file.owner if self._owner is None else self._owner
        row = {**asdict(file), "scans": list(file.scans), "photos": list(file.photos), "owner": owner}
        twins = sa.select(sa.func.max(files.c.computed_bytes)).where(
            files.c.owner == owner, files.c.sha256 == file.sha256
        )
        with self._alone(f"files of {owner}", file.sha256) as connection:
            admit(_amount(connection, files.c.owner == owner))
            place()
            row["computed_bytes"] = connection.execute(twins).scalar_one() or 0
            connection.execute(sa.insert(files).values(row))
        return replace(file, owner=owner, computed_bytes=row["computed_bytes"])

    def get(self, file_id: str) -> StoredFile | None:
        """Fetch."""
        with self._reading() as connection:
            query = sa.select(files).where(files.c.id == file_id, self._mine)
            row = connection.execute(query).mappings().one_or_none()
        return None if row is None else _file(row)

    def find(self, limit: int, offset: int) -> tuple[Sequence[StoredFile], int]:
        """List, newest first, with the number of all."""
        query = sa.select(files).where(self._mine).order_by(files.c.created.desc(), files.c.id.desc())
        with self._reading() as connection:
            number = connection.execute(sa.select(sa.func.count()).select_from(files).where(self._mine)).scalar_one()
            rows = connection.execute(query.limit(limit).offset(offset)).mappings().all()
        return [_file(row) for row in rows], number

    def contents(self) -> frozenset[str]:
        """Give the hashes of all contents that files have."""
        with self._reading() as connection:
            return frozenset(connection.execute(sa.select(files.c.sha256).distinct()).scalars())

    def delete(self, file_id: str) -> bool:
        """Forget; False when it was unknown."""
        with self._engine.begin() as connection:
            return bool(connection.execute(sa.delete(files).where(files.c.id == file_id, self._mine)).rowcount)

    def note_computed(self, sha256: str, size: int) -> None:
        """Note how many bytes are kept of what was computed of a content."""
        with self._engine.begin() as connection:
            noted = sa.update(files).where(files.c.sha256 == sha256, self._mine)
            connection.execute(noted.values(computed_bytes=size))

    def remove_unused(self, sha256: str, remove: Callable[[], None], owner: str | None = None) -> bool:
        """Call `remove` if no file has this content, while nobody can add one; tell whether it was called."""
        whose = sa.true() if owner is None else files.c.owner == owner
        query = sa.select(sa.func.count()).select_from(files).where(files.c.sha256 == sha256, whose)
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
    def _alone(self, *names: str) -> Iterator[sa.Connection]:
        """Begin a transaction that is the only one for each of these: a content, the files of a project."""
        with self._engine.begin() as connection:
            for name in names:  # always that of the project first
                lock_name(connection, name)
            yield connection


def _amount(connection: sa.Connection, condition: sa.ColumnElement[bool]) -> StoredAmount:
    total = sa.func.coalesce(sa.func.sum(files.c.bytes + files.c.computed_bytes), 0)
    number, size = connection.execute(sa.select(sa.func.count(), total).where(condition)).one()
    return StoredAmount(number, int(size))


def _file(row: sa.RowMapping) -> StoredFile:
    return StoredFile(**{**row, "scans": tuple(row["scans"]), "photos": tuple(row["photos"])})
