"""What a computing process is handed, and what it hands back: it knows no store, and has no credentials of one.

Who starts it looks up the blobs that the step needs (`hand_out`). The process reads these paths, and makes blobs in a
directory of its own (`service.adapters.files.handed_files`). From there those that it may make come into the store when
it has ended (`take_in`).
"""

import os
import stat
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from service.errors import StorageError
from service.ports import BlobStore, Json
from service.use_cases.steps.step_needs import StepNeeds

LONGEST_MADE = 256_000_000
"""Bytes of what is taken into memory."""
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


def pinned(paths: Mapping[str, str], directory: Path) -> dict[str, str]:
    """Give blobs second names in a directory, which nobody replaces.

    A process is left files to read, not names: what another upload of the same content, or another computation of the
    same features, puts under the same name it could not open. Where the file system has no second names, or this is
    another one than that of the blobs, the first ones are given.

    Parameters
    ----------
    paths
        Of blobs, by key.
    directory
        Of the process, removed when it has ended.
    """
    found = {}
    for number, (key, path) in enumerate(paths.items()):
        name = directory / f"read-{number}"
        try:
            name.hardlink_to(path)
        except OSError:
            name = Path(path)
        found[key] = str(name)
    return found


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


def made_bytes(directory: Path, key: str) -> bytes:
    """Return what a step that has ended made under a key.

    Raises
    ------
    StorageError
        It made nothing, or something else.
    """
    path = directory.resolve() / MADE / key
    if not path.exists():
        raise StorageError(f"a computation did not make '{key}'")
    found = path.lstat()
    # no symbolic link on the way: it would be followed with rights that the computation had not
    if path.resolve() != path or not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
        raise StorageError(f"a computation made '{key}', which is not its own")
    if found.st_size > LONGEST_MADE:
        raise StorageError(f"a computation made '{key}' of {found.st_size} bytes, at most {LONGEST_MADE} are taken")
    return path.read_bytes()
