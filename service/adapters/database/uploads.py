"""What is known of resumable uploads that several machines share, and who may write to each."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime

import sqlalchemy as sa

from service.adapters.database.executors import clock
from service.adapters.database.tables import upload_parts, uploads
from service.errors import NoSuchUploadError
from service.ports import PendingUpload, UploadState

HELD_FOR_S = 10.0
"""Without a sign of life from its holder, an upload is free after so long."""


@dataclass(frozen=True)
class UploadPart:
    """Bytes of an upload that are in the object store."""

    start: int
    bytes: int
    holder: str
    """Who has sent them; part of their name."""


class DatabaseUploads:
    """Keep uploads, their parts, and leases on them. Only the holder of a lease can change an upload.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._engine = engine

    def create(self, upload: PendingUpload) -> None:
        """Enter an upload."""
        with self._engine.begin() as connection:
            row = {"id": upload.id, "owner": upload.owner, "record": _record(upload), "arrived": 0}
            free = {"holder": "", "held_until": 0.0, "wanted": False, "touched": clock(connection)}
            connection.execute(sa.insert(uploads).values(**row, **free))

    def find(self, upload_id: str) -> UploadState:
        """Tell how far an upload is. NoSuchUploadError when it is unknown."""
        with self._engine.execution_options(reads_only=True).begin() as connection:
            row = connection.execute(sa.select(uploads).where(uploads.c.id == upload_id)).one_or_none()
        if row is None:
            raise NoSuchUploadError(upload_id)
        upload = PendingUpload(**{**row.record, "created": datetime.fromisoformat(row.record["created"])})
        done = upload.finished or upload.problem is not None
        return UploadState(upload, upload.length if done else row.arrived, datetime.fromtimestamp(row.touched, UTC))

    def ids(self, owner: str | None) -> Sequence[str]:
        """List the uploads of a project, or all."""
        mine = sa.true() if owner is None else uploads.c.owner == owner
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return list(connection.execute(sa.select(uploads.c.id).where(mine).order_by(uploads.c.id)).scalars())

    def promised_bytes(self, owner: str | None) -> int:
        """Sum up what the uploads of a project, or all, that are neither finished nor refused will have."""
        mine = sa.true() if owner is None else uploads.c.owner == owner
        with self._engine.execution_options(reads_only=True).begin() as connection:
            records = connection.execute(sa.select(uploads.c.record).where(mine)).scalars()
            return sum(each["length"] for each in records if not each["finished"] and each["problem"] is None)

    def unfinished(self, owner: str | None) -> int:
        """Count the uploads of a project, or all, that have become no file."""
        mine = sa.true() if owner is None else uploads.c.owner == owner
        with self._engine.execution_options(reads_only=True).begin() as connection:
            records = connection.execute(sa.select(uploads.c.record).where(mine)).scalars()
            return sum(not each["finished"] for each in records)

    def parts(self, upload_id: str) -> Sequence[UploadPart]:
        """List the parts of an upload in their order."""
        columns = (upload_parts.c.start, upload_parts.c.bytes, upload_parts.c.holder)
        query = sa.select(*columns).where(upload_parts.c.upload_id == upload_id).order_by(upload_parts.c.start)
        with self._engine.execution_options(reads_only=True).begin() as connection:
            return [UploadPart(*row) for row in connection.execute(query)]

    def want(self, upload_id: str) -> None:
        """Let the holder know that another one wants the upload."""
        with self._engine.begin() as connection:
            connection.execute(sa.update(uploads).where(uploads.c.id == upload_id).values(wanted=True))

    def take(self, upload_id: str, holder: str) -> bool:
        """Become the holder; False while another one is."""
        with self._engine.begin() as connection:
            now = clock(connection)
            free = sa.and_(uploads.c.id == upload_id, uploads.c.held_until < now)
            values = {"holder": holder, "held_until": now + HELD_FOR_S, "wanted": False}
            return bool(connection.execute(sa.update(uploads).where(free).values(values)).rowcount)

    def renew(self, upload_id: str, holder: str, *, active: bool) -> bool | None:
        """Stay the holder; tell whether another one wants the upload. None: it is lost."""
        with self._engine.begin() as connection:
            now = clock(connection)
            values = {"held_until": now + HELD_FOR_S, **({"touched": now} if active else {})}
            if not connection.execute(sa.update(uploads).where(_held(upload_id, holder)).values(values)).rowcount:
                return None
            return bool(connection.execute(sa.select(uploads.c.wanted).where(uploads.c.id == upload_id)).scalar())

    def release(self, upload_id: str, holder: str) -> None:
        """Be the holder no more."""
        with self._engine.begin() as connection:
            change = sa.update(uploads).where(_held(upload_id, holder)).values(holder="", held_until=0.0)
            connection.execute(change)

    def add(self, upload_id: str, part: UploadPart) -> bool:
        """Enter a part that continues the upload; False when its sender is not the holder any more."""
        with self._engine.begin() as connection:
            continued = sa.and_(_held(upload_id, part.holder), uploads.c.arrived == part.start)
            values = {"arrived": part.start + part.bytes, "touched": clock(connection)}
            if not connection.execute(sa.update(uploads).where(continued).values(values)).rowcount:
                return False
            connection.execute(sa.insert(upload_parts).values(upload_id=upload_id, **asdict(part)))
            return True

    def save(self, upload: PendingUpload, holder: str) -> bool:
        """Record a change; False when it is not the holder's any more."""
        with self._engine.begin() as connection:
            change = sa.update(uploads).where(_held(upload.id, holder)).values(record=_record(upload))
            saved = bool(connection.execute(change).rowcount)
            if saved and (upload.finished or upload.problem is not None):
                connection.execute(sa.delete(upload_parts).where(upload_parts.c.upload_id == upload.id))
            return saved

    def remove(self, upload_id: str, holder: str) -> bool:
        """Remove an upload; False when it is not the holder's any more."""
        with self._engine.begin() as connection:
            return bool(connection.execute(sa.delete(uploads).where(_held(upload_id, holder))).rowcount)


def _held(upload_id: str, holder: str) -> sa.ColumnElement[bool]:
    return sa.and_(uploads.c.id == upload_id, uploads.c.holder == holder)


def _record(upload: PendingUpload) -> object:
    return json.loads(json.dumps({**asdict(upload), "created": upload.created.isoformat()}))
