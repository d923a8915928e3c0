"""Blobs in a local directory: whole or not at all, in constant memory."""

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from uuid import uuid4

from service.adapters.files.disk_space import set_aside
from service.errors import FileTooLargeError, StorageError
from service.use_cases.uploads.upload_threads import undisturbed

PART = r"\w[\w .()+\-]*"
"""As stations are called, after which downloads are: letters of any script, blanks, brackets."""
KEY = re.compile(f"{PART}(/{PART})*/?")
BLOCK_BYTES = 1 << 20


def checked_key(key: str) -> str:
    """Refuse keys that could leave the store (absolute, ``..``, hidden names, odd characters).

    Raises
    ------
    StorageError
        Keys are made by the service, so a bad one is its own fault.
    """
    if not KEY.fullmatch(key):
        raise StorageError(f"'{key}' is not a key of the blob store")
    return key


class LocalFiles:
    """Keep blobs below ``<directory>/blobs``.

    Parameters
    ----------
    directory
        Where the service keeps its data.
    scratch
        Where unfinished blobs and scratch directories lie; by default ``scratch`` beside the blobs. A computation gets
        a directory of its own, so that all it leaves behind can be removed when it dies. Where this is another file
        system than that of the blobs, unfinished blobs lie beside these nevertheless.
    """

    def __init__(self, directory: Path, scratch: Path | None = None) -> None:
        self._blobs = directory.resolve() / "blobs"
        beside = directory.resolve() / "scratch"
        self._scratch = scratch or beside
        for each in (self._blobs, self._scratch):
            each.mkdir(parents=True, exist_ok=True)
        self._partial = self._scratch
        if self._scratch.stat().st_dev != self._blobs.stat().st_dev:
            self._partial = beside
            beside.mkdir(exist_ok=True)

    async def write_stream(
        self, key: str, chunks: AsyncIterator[bytes], max_bytes: int, expected_bytes: int = 0
    ) -> tuple[int, str]:
        """Store a stream in constant memory; give its size and sha256. Nothing remains when the stream breaks."""
        partial = _PartialFile(self._partial)
        block = bytearray()
        try:
            await undisturbed(partial.set_aside, min(expected_bytes, max_bytes))
            async for chunk in chunks:
                block += chunk
                if partial.size + len(block) > max_bytes:
                    raise FileTooLargeError("the upload", partial.size + len(block), max_bytes)
                if len(block) >= BLOCK_BYTES:
                    # disk and hash keep their hands off the event loop
                    await undisturbed(partial.write, bytes(block))
                    block.clear()
            await undisturbed(partial.write, bytes(block))
            await undisturbed(partial.finish, self._path(key))
        finally:
            partial.discard()
        return partial.size, partial.digest.hexdigest()

    def write_bytes(self, key: str, data: bytes) -> None:
        """Store small content."""
        partial = _PartialFile(self._partial)
        try:
            partial.write(data)
            partial.finish(self._path(key))
        finally:
            partial.discard()

    def put_file(self, key: str, path: Path) -> None:
        """Move a finished local file into the store; a file from another file system is copied first."""
        target = self._path(key)
        if path.stat().st_dev != self._blobs.stat().st_dev:
            descriptor, name = tempfile.mkstemp(dir=self._partial, prefix="partial-")
            os.close(descriptor)
            try:
                shutil.copyfile(path, name)
                self._adopt(Path(name), target)
            finally:
                Path(name).unlink(missing_ok=True)
            path.unlink()
        else:
            self._adopt(path, target)

    def put_copy(self, key: str, path: Path) -> None:
        """Put a finished local file, which is never written again, into the store; the file itself stays.

        Where the file system can, both are one file with two names.
        """
        copy = self._partial / f"partial-{uuid4().hex}"
        try:
            try:
                copy.hardlink_to(path)
            except OSError:  # another file system, or one without hard links
                shutil.copyfile(path, copy)
            self._adopt(copy, self._path(key))
        finally:
            copy.unlink(missing_ok=True)

    def prepare_move(self, key: str, new_key: str) -> None:
        """Do nothing: a move is quick."""

    def move(self, key: str, new_key: str) -> None:
        """Rename a blob; what lay under the new key is replaced. FileNotFoundError when absent."""
        _move(self._path(key), self._path(new_key))

    def local_path(self, key: str) -> Path:
        """Give the blob itself. FileNotFoundError when absent."""
        path = self._path(key)
        if not path.is_file():
            raise FileNotFoundError(key)
        return path

    def size(self, key: str) -> int:
        """Give the number of bytes of a blob. FileNotFoundError when absent."""
        return self._path(key).stat().st_size

    def exists(self, key: str) -> bool:
        """Tell whether the key is stored."""
        return self._path(key).is_file()

    def keys(self, prefix: str) -> Sequence[str]:
        """List the keys under a prefix, which is a folder or the beginning of a name."""
        if prefix:
            checked_key(prefix)
        folder = self._blobs / (prefix.rpartition("/")[0])
        found = (path.relative_to(self._blobs).as_posix() for path in folder.rglob("*") if path.is_file())
        return sorted(key for key in found if key.startswith(prefix))

    def total(self, prefix: str) -> int:
        """Sum up the bytes of all blobs under a prefix."""
        size = 0
        for key in self.keys(prefix):
            with suppress(FileNotFoundError):
                size += self.size(key)
        return size

    def unchanged_since(self, prefix: str, moment: datetime) -> Sequence[str]:
        """List the keys under a prefix that were last written before a moment."""
        return [key for key in self.keys(prefix) if _is_older(self._blobs / key, moment)]

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove unfinished blobs that nobody has written to since a moment; give their number."""
        found = [path for path in self._partial.glob("partial-*") if _is_older(path, moment)]
        for path in found:
            path.unlink(missing_ok=True)
        return len(found)

    def delete_prefix(self, prefix: str) -> None:
        """Remove a blob, or all in a folder; nothing happens when there is nothing."""
        path = self._path(prefix)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)

    def scratch(self) -> Path:
        """Give a new empty directory on the same file system; the caller removes it."""
        return Path(tempfile.mkdtemp(dir=self._scratch, prefix="work-"))

    def _path(self, key: str) -> Path:
        return self._blobs / checked_key(key).rstrip("/")

    def _adopt(self, path: Path, target: Path) -> None:
        with path.open("rb") as file:
            os.fsync(file.fileno())
        _move(path, target)


class _PartialFile:
    """A blob in the making: a temporary file that is renamed when it is complete."""

    def __init__(self, directory: Path) -> None:
        descriptor, name = tempfile.mkstemp(dir=directory, prefix="partial-")
        self._file = os.fdopen(descriptor, "wb")
        self._path = Path(name)
        self.digest = hashlib.sha256()
        self.size = 0

    def write(self, data: bytes) -> None:
        self._file.write(data)
        self.digest.update(data)
        self.size += len(data)

    def set_aside(self, size: int) -> None:
        """Keep room on the disk."""
        set_aside(self._file.fileno(), size)

    def finish(self, target: Path) -> None:
        self._file.truncate(self.size)  # gives back what was set aside in vain
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        _move(self._path, target)

    def discard(self) -> None:
        """Remove what was not finished."""
        self._file.close()
        self._path.unlink(missing_ok=True)


def _is_older(path: Path, moment: datetime) -> bool:
    """Tell whether a file was last written before a moment; one that has vanished was not."""
    with suppress(FileNotFoundError):
        return path.stat().st_mtime < moment.timestamp()
    return False


def _move(source: Path, target: Path) -> None:
    """Rename and make the new name durable."""
    target.parent.mkdir(parents=True, exist_ok=True)
    source.replace(target)
    folder = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
