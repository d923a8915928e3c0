"""Copies of remote blobs on this machine, shared by its processes; those unused for longest go when they are many."""

import errno
import fcntl
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import IO

from service.errors import InsufficientStorageError

PARTIAL = ".partial"
IN_USE_S = 120.0
"""A copy that was asked for so recently is not removed: somebody may be about to open it."""
MADE_AFRESH = 3


class LocalCache:
    """Keep copies under names that tell their content apart: a copy is never changed, only removed.

    Parameters
    ----------
    directory
        Of this machine alone.
    max_bytes
        Beyond this, copies are removed, those first that nobody has asked for for longest. What is in use counts and
        stays, so that more may be kept for a while.
    """

    def __init__(self, directory: Path, max_bytes: int) -> None:
        self._directory = directory.resolve()
        self._max_bytes = max_bytes
        self._directory.mkdir(parents=True, exist_ok=True)

    def get(self, identity: str, size: int, fetch: Callable[[IO[bytes]], None], pins: Path | None = None) -> Path:
        """Give a copy; it is fetched when it is not there, by one process at a time.

        Parameters
        ----------
        identity
            Tells one content from all others.
        size
            Of the content; a copy of another size is taken for damaged and fetched again.
        fetch
            Writes the content to an empty file, or raises.
        pins
            Directory for a second name of the copy, by which it can be read however many others come; without it the
            copy must be opened within `IN_USE_S`.
        """
        entry = self._entry(identity)
        for _ in range(MADE_AFRESH):
            if not _is_whole(entry, size):
                self._fill(entry, size, fetch)
                self._trim()
            with suppress(FileNotFoundError):  # removed in between
                os.utime(entry)
                return _pinned(entry, pins)
        raise InsufficientStorageError("the cache of this machine is too small for what is computed")

    def adopt(self, identity: str, path: Path) -> None:
        """Take a local file that is never written again as a copy; the file itself stays."""
        entry = self._entry(identity)
        with suppress(OSError):  # there already, or on another file system: it will be fetched when it is needed
            entry.hardlink_to(path)
            os.utime(entry)
            self._trim()

    def remove_abandoned(self, moment: datetime) -> int:
        """Remove copies whose fetching broke off before a moment; give their number."""
        removed = 0
        for path in self._directory.glob(f"*{PARTIAL}"):
            with suppress(FileNotFoundError):
                if path.stat().st_mtime < moment.timestamp():
                    path.unlink()
                    removed += 1
        return removed

    def _entry(self, identity: str) -> Path:
        return self._directory / hashlib.sha256(identity.encode()).hexdigest()

    def _fill(self, entry: Path, size: int, fetch: Callable[[IO[bytes]], None]) -> None:
        with _alone(entry.with_suffix(PARTIAL)) as file:
            if _is_whole(entry, size):
                return  # another process was quicker
            try:
                file.truncate(0)
                fetch(file)
                file.flush()
            except OSError as error:
                if error.errno in {errno.ENOSPC, errno.EDQUOT}:
                    file.truncate(0)
                    raise InsufficientStorageError("the disk of this machine is full") from None
                raise
            entry.with_suffix(PARTIAL).replace(entry)

    def _trim(self) -> None:
        """Remove the copies that were not asked for for longest until the rest is small enough."""
        with _alone(self._directory / "trimming"):
            found = []
            for path in self._directory.iterdir():
                with suppress(FileNotFoundError):
                    if not path.suffix and path.name != "trimming":
                        found.append((path.stat().st_mtime, path.stat().st_size, path))
            total = sum(size for _, size, _ in found)
            for used, size, path in sorted(found):
                if total <= self._max_bytes or used > time.time() - IN_USE_S:
                    break
                path.unlink(missing_ok=True)
                total -= size


@contextmanager
def _alone(path: Path) -> Iterator[IO[bytes]]:
    """Open a file that no other process has open this way; the lock ends with the process."""
    while True:
        with path.open("ab") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                    yield file
                    return
        # renamed or removed by the one who had it: the name belongs to another file now


def _is_whole(entry: Path, size: int) -> bool:
    with suppress(FileNotFoundError):
        return entry.stat().st_size == size
    return False


def _pinned(entry: Path, pins: Path | None) -> Path:
    if pins is None:
        return entry
    pin = pins / f"pin-{entry.name}"
    try:
        pin.hardlink_to(entry)
    except FileExistsError:
        return pin
    except FileNotFoundError:
        raise
    except OSError:  # a file system without hard links
        return entry
    return pin
