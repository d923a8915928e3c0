"""How a computation tells how far it is, and learns that it should stop."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable


@runtime_checkable
class Progress(Protocol):
    """Receive progress. An implementation may raise `CancelledError` to stop the computation."""

    def report(self, fraction: float, message: str) -> None:
        """Say that `fraction` (0..1) of the work is done and what is being done now."""


@dataclass(frozen=True)
class NoProgress:
    """Listen to nothing."""

    def report(self, fraction: float, message: str) -> None:
        """Ignore the report."""


@dataclass(frozen=True)
class ProgressSection:
    """Map the 0..1 of a part onto [start, end] of the whole."""

    parent: Progress
    start: float
    end: float

    def report(self, fraction: float, message: str) -> None:
        """Pass the report on, scaled."""
        self.parent.report(self.start + (self.end - self.start) * fraction, message)
