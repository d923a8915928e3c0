"""Files that appear whole or not at all, also when the disk is full in the middle."""

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from service.errors import InsufficientStorageError

FULL = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))
WORDS_OF_FULL = re.compile(r"No space left|quota exceeded|File too large|os error (27|28|122)\b|ErrorWriteFailed")
"""By which libraries in other languages tell it."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give the name under which a file is to be written; it gets its own name when all went well.

    Raises
    ------
    InsufficientStorageError
        The disk was full; nothing remains.
    """
    partial = path.with_name(f".partial-{path.name}")
    try:
        yield partial
        partial.replace(path)
    except (OSError, RuntimeError) as fault:
        if is_full(fault):
            raise InsufficientStorageError(f"the disk is full: {path.name} could not be written") from fault
        raise
    finally:
        partial.unlink(missing_ok=True)


def is_full(fault: BaseException) -> bool:
    """Tell whether a fault in writing means that there is no room."""
    if isinstance(fault, OSError) and fault.errno in FULL:
        return True
    return WORDS_OF_FULL.search(str(fault)) is not None


def require_length(path: Path, least: int) -> None:
    """Refuse a file that is shorter than was written: some libraries do not say that the disk is full.

    Raises
    ------
    OSError
        It is, as of a full disk.
    """
    if path.stat().st_size < least:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
