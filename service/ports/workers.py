"""The queue, and who works on it."""

from collections.abc import Sequence
from typing import Protocol


class Queue(Protocol):
    """Steer the engine from the web process."""

    def cancel(self, job_id: str) -> None:
        """Ask that a job's computation stop (within 5 s)."""

    def live_workers(self) -> int:
        """Count workers whose heart beats."""


class ExecutorRegistry(Protocol):
    """Know which workers live."""

    def register(self, executor_id: str) -> None:
        """Enter a worker."""

    def beat(self, executor_id: str) -> bool:
        """Say that a worker lives; False when it was taken for dead meanwhile (it must stop at once)."""

    def remove(self, executor_id: str) -> None:
        """Strike out a worker that stops in order."""

    def bury_dead(self, executor_id: str, *, by_heart: bool = True) -> None:
        """Strike out workers whose process is gone or whose heart has not beaten for a while, except the caller.

        Not `by_heart` when there is reason to believe that hearts beat and could not be heard.
        """

    def live(self) -> Sequence[str]:
        """List the workers that are entered and not overdue."""

    def entered(self) -> Sequence[str]:
        """List all workers that are entered."""

    def lease(self, name: str, holder: str, seconds: float) -> bool:
        """Take or keep a named lease; False while someone else holds it."""
