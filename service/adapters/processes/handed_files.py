"""What a computing process is handed, and what it hands back: it knows no store, and has no credentials of one.

Who starts it looks up the blobs that the step needs (`hand_out`). The process reads these paths, and makes blobs in a
directory of its own (`HandedFiles`). From there those that it may make come into the store when it has ended
(`take_in`).
"""

import os
import stat
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from service.adapters.files.local_files import LocalFiles
from service.errors import StorageError
from service.ports import BlobStore, Json
from service.use_cases.steps.step_needs import StepNeeds

MADE = "blobs"
"""Folder below the directory of a process in which it makes blobs."""


class WantedError(Exception):
    """A step needs a blob that it was not handed, because it seldom does.

    Parameters
    ----------
    key
        Of the blob.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        super().__init__(key)


class HandedFiles:
    """The blobs of one step, as `service.ports.StepFiles`.

    Parameters
    ----------
    paths
        By key, of what it was handed.
    on_request
        Keys of what is there and was not handed.
    directory
        Its own, for what it makes.
    """

    def __init__(self, paths: Mapping[str, str], on_request: Sequence[str], directory: Path) -> None:
        self._paths, self._on_request = paths, frozenset(on_request)
        self._made = LocalFiles(directory, directory)

    async def write_stream(
        self, key: str, chunks: AsyncIterator[bytes], max_bytes: int, expected_bytes: int = 0
    ) -> tuple[int, str]:
        """Make a blob of a stream."""
        return await self._made.write_stream(key, chunks, max_bytes, expected_bytes)

    def write_bytes(self, key: str, data: bytes) -> None:
        """Make a small blob."""
        self._made.write_bytes(key, data)

    def put_file(self, key: str, path: Path) -> None:
        """Make a blob of a finished file."""
        self._made.put_file(key, path)

    def local_path(self, key: str) -> Path:
        """Give a blob that was handed or made. FileNotFoundError when absent.

        Raises
        ------
        WantedError
            It has to be asked for.
        """
        if key in self._paths:
            return Path(self._paths[key])
        if key in self._on_request:
            raise WantedError(key)
        return self._made.local_path(key)

    def size(self, key: str) -> int:
        """Give the number of bytes of a blob that was handed or made. FileNotFoundError when absent."""
        return self.local_path(key).stat().st_size

    def exists(self, key: str) -> bool:
        """Tell whether a blob was handed or made."""
        return key in self._paths or self._made.exists(key)

    def delete_prefix(self, prefix: str) -> None:
        """Remove what was made."""
        self._made.delete_prefix(prefix)

    def scratch(self) -> Path:
        """Give a new empty directory."""
        return self._made.scratch()


def hand_out(needs: StepNeeds, blobs: BlobStore, *, seldom: bool) -> Json:
    """Look up what a step needs; give the members of its request that tell of it.

    Parameters
    ----------
    needs
        Of the step.
    blobs
        The store.
    seldom
        Whether also what it seldom needs.
    """
    done = _looked_up([needs.done_before] if needs.done_before else [], blobs)
    wanted = () if done else sorted(needs.reads | (needs.seldom_reads if seldom else frozenset()))
    paths = {**_looked_up(wanted, blobs), **done}
    return {"paths": paths, "on_request": sorted(needs.seldom_reads - paths.keys()) if not seldom else []}


def _looked_up(keys: Sequence[str], blobs: BlobStore) -> dict[str, str]:
    paths = {}
    for key in keys:
        with suppress(FileNotFoundError):
            paths[key] = str(blobs.local_path(key))
    return paths


def take_in(needs: StepNeeds, directory: Path, blobs: BlobStore) -> None:
    """Store what a step that has ended made; only what it may make, and only files that are its own.

    Raises
    ------
    StorageError
        It made something else.
    """
    made = directory / MADE
    for folder, _, names in os.walk(made):  # goes into no folder behind a symbolic link
        for name in sorted(names):
            path = Path(folder, name)
            key, found = path.relative_to(made).as_posix(), path.lstat()
            if not (needs.may_make(key) and stat.S_ISREG(found.st_mode) and found.st_nlink == 1):
                raise StorageError(f"a computation made '{key}', which is not its own")
            blobs.put_file(key, path)
