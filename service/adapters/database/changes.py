"""Whether an embedded database may have changed, without asking it: what waits for a change looks at a file's time."""

import os
import time
from contextlib import suppress

import sqlalchemy as sa

ANYWAY_S = 1.0
"""After so long it is said that there may have been a change, whatever the file says."""
SETTLED_S = 0.05
"""Times of files are those of the kernel's last tick: two changes soon after each other may have the same one."""


class Changes:
    """Compare the log of changes (`-wal`) of an embedded database with what it was; a server may always have changed.

    Parameters
    ----------
    engine
        From `connect`.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._log = f"{engine.url.database}-wal" if engine.dialect.name == "sqlite" else None
        self._found: tuple[int, int] | None = None
        self._known: tuple[int, int] | None = None
        self._until = 0.0

    def may_be(self) -> bool:
        """Tell whether something may have changed since what `note` was told of was seen."""
        self._found = self._look()
        return self._found is None or self._found != self._known or time.monotonic() > self._until

    def note(self, *, new: bool) -> None:
        """Note what was seen after `may_be`: when it was nothing new, the same need not be looked at again."""
        self._known, self._until = None if new else self._found, time.monotonic() + ANYWAY_S

    def _look(self) -> tuple[int, int] | None:
        """Give time and size of the file; None when there is none, or it was written to just now."""
        with suppress(OSError):
            if self._log is not None:
                file = os.stat(self._log)  # noqa: PTH116 - ten times a second
                if abs(time.time() - file.st_mtime) > SETTLED_S:
                    return file.st_mtime_ns, file.st_size
        return None
