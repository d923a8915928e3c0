"""Resumable uploads in a local directory, shared by all API processes that use it.

Each upload is a folder with its bytes (``content``) and what is known of it (``upload.json``). Who writes to it holds a
lock of the operating system on the folder, which ends with the process, however it ends.
"""

import fcntl
import json
import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path

from service.adapters.files.disk_space import FULL, set_aside
from service.errors import InsufficientStorageError, NoSuchUploadError
from service.names.identifiers import is_identifier, new_identifier
from service.ports import PendingUpload, UploadState, narrowed

RECORD, CONTENT, VERIFIED, ASKED = "upload.json", "content", "verified", "asked"
HALF_MADE = "."
"""Beginning of the names of folders that are no uploads yet, or no longer."""


class LocalUploads:
    """Keep uploads below a directory.

    Parameters
    ----------
    directory
        On the file system of the blobs, so that finished files need not be copied.
    owner
        Project whose uploads these are; None: those of all.
    """

    def __init__(self, directory: Path, owner: str | None = None) -> None:
        self._directory = directory.resolve()
        self._owner = owner

    def of(self, owner: str) -> "LocalUploads":
        """Give the uploads of one project."""
        return LocalUploads(self._directory, narrowed(self._owner, owner))

    def create(self, upload: PendingUpload) -> None:
        """Enter a new upload, which is empty."""
        if self._owner is not None:
            upload = replace(upload, owner=self._owner)
        made = self._directory / f"{HALF_MADE}{upload.id}"
        made.mkdir(parents=True)
        try:
            (made / CONTENT).touch()
            _save(made, upload)
        except BaseException:
            shutil.rmtree(made, ignore_errors=True)
            raise
        made.rename(self._directory / upload.id)

    def find(self, upload_id: str) -> UploadState:
        """Tell how far an upload is. NoSuchUploadError when it is unknown."""
        state = _state(self._folder(upload_id), upload_id)
        if self._owner not in {None, state.upload.owner}:
            raise NoSuchUploadError(upload_id)
        return state

    def lock(self, upload_id: str) -> "LockedFolder | None":
        """Open an upload; None while it is open elsewhere. NoSuchUploadError when it is unknown."""
        folder = self._folder(upload_id)
        self.find(upload_id)
        try:
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            raise NoSuchUploadError(upload_id) from None
        opened = None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(descriptor), folder.stat()):
                opened = LockedFolder(folder, upload_id, descriptor)
        except BlockingIOError:
            return None
        except FileNotFoundError:
            raise NoSuchUploadError(upload_id) from None
        finally:
            if opened is None:
                os.close(descriptor)
        if opened is None:  # removed since it was opened here
            raise NoSuchUploadError(upload_id)
        return opened

    def ask_for(self, upload_id: str) -> None:
        """Let whoever has the upload open know that it is wanted."""
        with suppress(FileNotFoundError, NoSuchUploadError):
            self.find(upload_id)
            (self._folder(upload_id) / ASKED).touch()

    def ids(self) -> Sequence[str]:
        """List all uploads."""
        if not self._directory.is_dir():
            return []
        return sorted(path.name for path in self._directory.iterdir() if self._has(path.name))

    def promised_bytes(self) -> int:
        """Sum up what the uploads that are neither finished nor refused will have."""
        promised = 0
        for upload_id in os.listdir(self._directory) if self._directory.is_dir() else ():  # noqa: PTH208 - the quickest
            # those that are done have no bytes any more
            if is_identifier(upload_id) and (self._directory / upload_id / CONTENT).exists():
                with suppress(NoSuchUploadError):
                    owner, length = _promise(self._directory / upload_id)
                    promised += length if self._owner in {None, owner} else 0
        return promised

    def unfinished(self) -> int:
        """Count the uploads that have become no file: those on their way, and those that were refused."""
        number = 0
        for upload_id in os.listdir(self._directory) if self._directory.is_dir() else ():  # noqa: PTH208 - the quickest
            folder = self._directory / upload_id
            if is_identifier(upload_id):
                with suppress(NoSuchUploadError):
                    mine = self._owner in {None, _promise(folder)[0]}
                    number += mine and ((folder / CONTENT).exists() or _is_refused(folder))
        return number

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove what killed processes left half-made before a moment; give the number."""
        removed = 0
        for folder in self._directory.glob(f"{HALF_MADE}*"):
            with suppress(FileNotFoundError):
                if folder.stat().st_mtime < moment.timestamp():
                    shutil.rmtree(folder, ignore_errors=True)
                    removed += 1
        return removed

    def _has(self, upload_id: str) -> bool:
        if not is_identifier(upload_id):
            return False
        if self._owner is None:
            return True
        try:
            self.find(upload_id)
        except NoSuchUploadError:
            return False
        return True

    def _folder(self, upload_id: str) -> Path:
        if not is_identifier(upload_id):
            raise NoSuchUploadError(upload_id)
        return self._directory / upload_id


class LockedFolder:
    """An upload that nobody else writes to until it is closed.

    Parameters
    ----------
    folder, upload_id
        Which.
    descriptor
        Of the folder, with the lock; closed by `close`.
    """

    def __init__(self, folder: Path, upload_id: str, descriptor: int) -> None:
        self._folder = folder
        self._id = upload_id
        self._descriptor = descriptor
        (folder / ASKED).unlink(missing_ok=True)
        self.cut()
        with suppress(FileNotFoundError):
            self._content = os.open(self.path, os.O_WRONLY | os.O_APPEND)
            return
        self._content = -1  # finished or refused

    @property
    def state(self) -> UploadState:
        """Tell how far it is."""
        return _state(self._folder, self._id)

    @property
    def path(self) -> Path:
        """Give the file with the bytes."""
        return self._folder / CONTENT

    def whole(self) -> Path:
        """Give the file with the bytes."""
        return self.path

    def set_room_aside(self, ahead: int) -> bool:
        """Keep room on the disk for so many bytes more, or the rest if it is less; False where that is not possible."""
        if self._content < 0:
            return False
        return set_aside(self._content, min(self.state.upload.length, os.fstat(self._content).st_size + ahead))

    def give_room_back(self) -> None:
        """Keep no room any more for what is still to come."""
        if self._content >= 0:
            os.ftruncate(self._content, os.fstat(self._content).st_size)

    def touch(self) -> None:
        """Note that somebody is about to write."""
        os.utime(self._folder / RECORD)

    def write(self, data: bytes) -> None:
        """Append.

        Raises
        ------
        InsufficientStorageError
            The disk is full.
        """
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._content, rest) :]
        except OSError as error:
            if error.errno in FULL:
                raise InsufficientStorageError("the disk of this service is full; try again later") from None
            raise

    def sync(self) -> None:
        """Make durable what was written."""
        if self._content >= 0:
            os.fsync(self._content)

    def doubt(self) -> None:
        """Declare all that is written from now on as not verified; it goes if the process dies before `trust`."""
        _write_whole(self._folder / VERIFIED, str(self.path.stat().st_size))

    def trust(self) -> None:
        """Declare what was written as verified."""
        (self._folder / VERIFIED).unlink(missing_ok=True)

    def cut(self) -> None:
        """Remove what is not verified."""
        with suppress(FileNotFoundError):
            verified = int((self._folder / VERIFIED).read_text())
            if self.path.stat().st_size > verified:
                os.truncate(self.path, verified)
            self.trust()

    def asked_for(self) -> bool:
        """Tell whether another request wants the upload."""
        return (self._folder / ASKED).exists()

    def save(self, upload: PendingUpload) -> None:
        """Record a change; the bytes of an upload that is finished or refused go."""
        _save(self._folder, upload)
        if upload.finished or upload.problem is not None:
            self.path.unlink(missing_ok=True)

    def remove(self) -> None:
        """Remove the upload: by its name at once, whatever happens then."""
        removed = self._folder.with_name(f"{HALF_MADE}{new_identifier()}")
        self._folder.rename(removed)
        shutil.rmtree(removed, ignore_errors=True)

    def close(self) -> None:
        """Let others have it."""
        if self._content >= 0:
            os.close(self._content)
        os.close(self._descriptor)


def _state(folder: Path, upload_id: str) -> UploadState:
    try:
        record = folder / RECORD
        known = json.loads(record.read_bytes())
        touched = record.stat().st_mtime
    except FileNotFoundError:
        raise NoSuchUploadError(upload_id) from None
    upload = PendingUpload(**{**known, "created": datetime.fromisoformat(known["created"])})
    offset = upload.length
    with suppress(FileNotFoundError):
        content = (folder / CONTENT).stat()
        offset, touched = content.st_size, max(touched, content.st_mtime)
        with suppress(FileNotFoundError):
            offset = int((folder / VERIFIED).read_text())
    return UploadState(upload, offset, datetime.fromtimestamp(touched, UTC))


@lru_cache(maxsize=10_000)
def _promise(folder: Path) -> tuple[str, int]:
    """Tell whose an upload is, and how long; neither ever changes."""
    upload = _state(folder, folder.name).upload
    return upload.owner, upload.length


@lru_cache(maxsize=10_000)
def _is_refused(folder: Path) -> bool:
    """Tell whether an upload without bytes, which has come to its end, was refused."""
    return _state(folder, folder.name).upload.problem is not None


def _save(folder: Path, upload: PendingUpload) -> None:
    _write_whole(folder / RECORD, json.dumps({**asdict(upload), "created": upload.created.isoformat()}))


def _write_whole(path: Path, text: str) -> None:
    """Write a small file so that it is there whole or not at all, also after a power cut."""
    partial = path.with_suffix(".partial")
    with partial.open("w") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)
