"""Who changed what, and what was refused."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol


@dataclass(frozen=True)
class AuditEntry:
    """One request that changed something or was refused."""

    time: datetime
    key_id: str
    """Key that it was made with; empty: none, or none that is valid."""
    project: str
    remote: str
    """Address that it came from."""
    method: str
    path: str
    """Without its query."""
    status: int
    """Of the answer."""
    request_id: str
    """Correlation id, which all log lines of the request have too."""


@dataclass(frozen=True)
class AuditFilter:
    """Which entries to list."""

    key_id: str | None = None
    project: str | None = None
    since: datetime | None = None
    limit: int = 100
    offset: int = 0


class AuditLog(Protocol):
    """Keep what was done."""

    def write(self, entry: AuditEntry) -> None:
        """Add."""

    def find(self, which: AuditFilter) -> tuple[Sequence[AuditEntry], int]:
        """List, newest first, with the number of all that match."""

    def number_of(self, project: str) -> int:
        """Count the entries of a project."""

    def forget_before(self, moment: datetime, statuses: Collection[int] | None = None) -> int:
        """Remove what is older, or only what was answered with one of these; give its number."""
