"""Resumable uploads that any machine can continue: parts in the object store, the rest in the database.

What comes lies in a file of this machine first. It counts when it is in the object store and the database knows it:
after every `PART_BYTES`, and when a request ends. When the last part is there, the machine that has it puts the file
together; parts that came through other machines are fetched.
"""

import os
import secrets
import shutil
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import IO

import sqlalchemy as sa
import structlog
from sqlalchemy.exc import SQLAlchemyError

from service.adapters.database.uploads import DatabaseUploads, UploadPart
from service.adapters.files.disk_space import FULL, set_aside
from service.adapters.files.object_files import ObjectFiles
from service.adapters.uploads.local_uploads import LocalUploads
from service.errors import InsufficientStorageError, NoSuchUploadError, StorageError, UploadLockedError
from service.names.identifiers import is_identifier
from service.ports import BlobStore, PendingUpload, UploadState, UploadStore, narrowed
from service.settings import Settings

UPLOADS = "uploads/"
PART_BYTES = 64 << 20
BLOCK_BYTES = 1 << 20
RENEW_S = 0.5
log = structlog.get_logger()


class SharedUploads:
    """Keep uploads for all machines.

    Parameters
    ----------
    rows
        What is known of them.
    blobs
        Where parts are kept.
    directory
        Of this machine, for what has just come.
    owner
        Project whose uploads these are; None: those of all.
    """

    def __init__(self, rows: DatabaseUploads, blobs: ObjectFiles, directory: Path, owner: str | None = None) -> None:
        self._rows, self._blobs, self._directory, self._owner = rows, blobs, directory.resolve(), owner

    def of(self, owner: str) -> "SharedUploads":
        """Give the uploads of one project."""
        return SharedUploads(self._rows, self._blobs, self._directory, narrowed(self._owner, owner))

    def create(self, upload: PendingUpload) -> None:
        """Enter a new upload, which is empty."""
        self._rows.create(upload if self._owner is None else replace(upload, owner=self._owner))

    def find(self, upload_id: str) -> UploadState:
        """Tell how far an upload is. NoSuchUploadError when it is unknown."""
        if not is_identifier(upload_id):
            raise NoSuchUploadError(upload_id)
        state = self._rows.find(upload_id)
        if self._owner not in {None, state.upload.owner}:
            raise NoSuchUploadError(upload_id)
        return state

    def lock(self, upload_id: str) -> "HeldUpload | None":
        """Open an upload; None while it is open elsewhere. NoSuchUploadError when it is unknown."""
        self.find(upload_id)
        holder = secrets.token_hex(8)
        if not self._rows.take(upload_id, holder):
            self.find(upload_id)
            return None
        return HeldUpload(self._rows, self._blobs, self._directory / upload_id, holder)

    def ask_for(self, upload_id: str) -> None:
        """Let whoever has the upload open know that it is wanted."""
        with suppress(NoSuchUploadError):
            self.find(upload_id)
            self._rows.want(upload_id)

    def ids(self) -> Sequence[str]:
        """List all uploads."""
        return self._rows.ids(self._owner)

    def promised_bytes(self) -> int:
        """Sum up what the uploads that are neither finished nor refused will have."""
        return self._rows.promised_bytes(self._owner)

    def unfinished(self) -> int:
        """Count the uploads that have become no file: those on their way, and those that were refused."""
        return self._rows.unfinished(self._owner)

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove files of this machine, and parts, that nobody has written to since a moment; give the number."""
        removed = 0
        for folder in self._directory.glob("*"):
            with suppress(FileNotFoundError):
                newest = max((path.stat().st_mtime for path in folder.iterdir()), default=folder.stat().st_mtime)
                if newest < moment.timestamp():
                    shutil.rmtree(folder, ignore_errors=True)
                    removed += 1
        known = set(self._rows.ids(None))
        old = {key.split("/")[1] for key in self._blobs.unchanged_since(UPLOADS, moment)}
        for upload_id in old - known:
            self._blobs.delete_prefix(f"{UPLOADS}{upload_id}/")
            removed += 1
        return removed


def upload_store_of(settings: Settings, database: sa.Engine, blobs: BlobStore) -> UploadStore:
    """Give the store of uploads that belongs to a store of blobs."""
    if isinstance(blobs, ObjectFiles):
        return SharedUploads(DatabaseUploads(database), blobs, settings.data_dir / "shared-uploads")
    return LocalUploads(settings.data_dir / "uploads")


class HeldUpload:
    """An upload that nobody else writes to until it is closed, or until this process has not been heard of for long.

    Parameters
    ----------
    rows, blobs
        As of `SharedUploads`.
    folder
        Of this machine and upload.
    holder
        Under this name the upload is held.
    """

    def __init__(self, rows: DatabaseUploads, blobs: ObjectFiles, folder: Path, holder: str) -> None:
        self._rows, self._blobs, self._folder, self._holder = rows, blobs, folder, holder
        self._id = folder.name
        self._start = self._sent = rows.find(self._id).offset
        self._size = 0
        self._file: IO[bytes] | None = None
        self._doubtful = False
        self._written, self._wanted, self._lost, self._closing = (threading.Event() for _ in range(4))
        self._renewal = threading.Thread(target=self._renew, name="upload", daemon=True)
        self._renewal.start()

    @property
    def state(self) -> UploadState:
        """Tell how far it is."""
        return self._rows.find(self._id)

    def whole(self) -> Path:
        """Give a file with all bytes, put together from what came through all machines."""
        parts = self._rows.parts(self._id)
        whole = self._folder / "whole"
        self._folder.mkdir(parents=True, exist_ok=True)
        with whole.open("wb") as file:
            for part in parts:
                if not self._copied(part, file):
                    self._blobs.append_to(self._key(part), file)
            file.flush()
            os.fsync(file.fileno())
            if file.tell() != self.state.upload.length:
                raise StorageError(f"parts of upload '{self._id}' are missing")
        return whole

    def set_room_aside(self, ahead: int) -> bool:
        """Keep room on the disk for so many bytes more, or the rest if it is less; False where that is not possible."""
        return set_aside(self._opened().fileno(), min(self.state.upload.length - self._start, self._size + ahead))

    def give_room_back(self) -> None:
        """Keep no room any more for what is still to come."""
        if self._file is not None:
            os.ftruncate(self._file.fileno(), self._size)

    def touch(self) -> None:
        """Note that somebody is about to write."""
        self._rows.renew(self._id, self._holder, active=True)

    def write(self, data: bytes) -> None:
        """Append.

        Raises
        ------
        UploadLockedError
            Another one holds the upload now.
        InsufficientStorageError
            The disk is full.
        """
        if self._lost.is_set():
            raise UploadLockedError(self._id)
        try:
            self._opened().write(data)
        except OSError as error:
            if error.errno in FULL:
                raise InsufficientStorageError("the disk of this service is full; try again later") from None
            raise
        self._size += len(data)
        self._written.set()
        if self._start + self._size - self._sent >= PART_BYTES and not self._doubtful:
            self._send()

    def sync(self) -> None:
        """Make durable what was written."""
        if not self._doubtful:
            self._send()

    def doubt(self) -> None:
        """Declare all that is written from now on as not verified: it is sent with `trust`."""
        self._doubtful = True

    def trust(self) -> None:
        """Declare what was written as verified."""
        self._doubtful = False
        self._send()

    def cut(self) -> None:
        """Remove what is not verified."""
        self._doubtful = False
        self._size = self._sent - self._start
        if self._file is not None:
            self._file.truncate(self._size)

    def asked_for(self) -> bool:
        """Tell whether another request wants the upload."""
        return self._wanted.is_set()

    def save(self, upload: PendingUpload) -> None:
        """Record a change; the bytes of an upload that is finished or refused go."""
        if not self._rows.save(upload, self._holder):
            raise UploadLockedError(self._id)
        if upload.finished or upload.problem is not None:
            self._forget_bytes()

    def remove(self) -> None:
        """Remove the upload."""
        if not self._rows.remove(self._id, self._holder):
            raise UploadLockedError(self._id)
        self._forget_bytes()

    def close(self) -> None:
        """Send what has come, if it counts, and let others have the upload."""
        try:
            if self._file is not None and not self._doubtful and not self._lost.is_set():
                self._send()
        except (StorageError, SQLAlchemyError, UploadLockedError) as error:  # the client sends it again
            log.warning("what came of an upload is lost", upload=self._id, error=str(error))
        finally:
            self._closing.set()
            self._renewal.join()
            if self._file is not None:
                self._file.close()
        with suppress(SQLAlchemyError):  # then it is free after a while
            self._rows.release(self._id, self._holder)

    def _renew(self) -> None:
        """Hold the upload as long as this process lives."""
        while not self._closing.wait(RENEW_S):
            active = self._written.is_set()
            self._written.clear()
            try:
                wanted = self._rows.renew(self._id, self._holder, active=active)
            except SQLAlchemyError as error:  # the database notices if another one takes the upload meanwhile
                log.warning("the database does not answer", upload=self._id, error=str(error))
                continue
            if wanted is None:
                self._lost.set()
                return
            if wanted:
                self._wanted.set()

    def _opened(self) -> IO[bytes]:
        if self._file is None:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._file = (self._folder / f"{self._start}-{self._holder}").open("ab", buffering=0)
        return self._file

    def _send(self) -> None:
        """Put into the object store what is not there yet, and enter it."""
        size = self._start + self._size - self._sent
        if self._file is None or size == 0:
            return
        part = UploadPart(self._sent, size, self._holder)
        self._blobs.put_stream(self._key(part), self._range(Path(self._file.name), self._sent - self._start, size))
        if not self._rows.add(self._id, part):
            self._lost.set()
            self._blobs.delete_prefix(self._key(part))
            raise UploadLockedError(self._id)
        self._sent += size

    def _copied(self, part: UploadPart, file: IO[bytes]) -> bool:
        """Append a part that came through this machine; False when it did not."""
        for path in self._folder.glob(f"*-{part.holder}"):
            first = part.start - int(path.name.partition("-")[0])
            if path.stat().st_size >= first + part.bytes:
                file.writelines(self._range(path, first, part.bytes))
                return True
        return False

    @staticmethod
    def _range(path: Path, first: int, size: int) -> Iterator[bytes]:
        with path.open("rb") as file:
            file.seek(first)
            while size > 0 and (block := file.read(min(BLOCK_BYTES, size))):
                yield block
                size -= len(block)

    def _key(self, part: UploadPart) -> str:
        return f"{UPLOADS}{self._id}/{part.start}-{part.holder}"

    def _forget_bytes(self) -> None:
        self._blobs.delete_prefix(f"{UPLOADS}{self._id}/")
        shutil.rmtree(self._folder, ignore_errors=True)
