"""Keep disks from filling up."""

import shutil
from pathlib import Path

from service.errors import InsufficientStorageError

BYTES_BETWEEN_CHECKS = 64_000_000


def require_free_space(directory: Path, least: int, coming_bytes: int = 0) -> None:
    """Refuse when less would remain free on the disk of a directory, which need not exist yet.

    Raises
    ------
    InsufficientStorageError
        With what is free.
    """
    directory = directory.resolve()
    while not directory.exists():
        directory = directory.parent
    free = shutil.disk_usage(directory).free
    if free - coming_bytes < least:
        raise InsufficientStorageError(f"{free} bytes are free on the disk of this service, {least} must remain")
