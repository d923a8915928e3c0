"""Who works on the queue, and what there is to see of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from service.ports.job_steps import StepFigures


class Queue(Protocol):
    """Look at the queue from the web process."""

    def live_workers(self) -> int:
        """Count workers whose heart beats."""

    def figures(self) -> StepFigures:
        """Tell how it stands with steps."""


@dataclass(frozen=True)
class DeadExecutor:
    """A worker that was struck out because it is gone."""

    id: str
    whole_service: bool
    """Its launcher is gone as well: it did not die by itself."""


class ExecutorRegistry(Protocol):
    """Know which workers live."""

    def register(self, executor_id: str, launcher: int | None = None) -> None:
        """Enter a worker, and the process that keeps it running."""

    def beat(self, executor_id: str) -> bool:
        """Say that a worker lives; False when it was taken for dead meanwhile (it must stop at once)."""

    def remove(self, executor_id: str) -> None:
        """Strike out a worker that stops in order."""

    def bury_dead(self, executor_id: str, *, by_heart: bool = True) -> Sequence[DeadExecutor]:
        """Strike out workers whose process is gone or whose heart has not beaten for a while, except the caller.

        Not `by_heart` when there is reason to believe that hearts beat and could not be heard.
        """

    def live(self) -> Sequence[str]:
        """List the workers that are entered and not overdue."""

    def lease(self, name: str, holder: str, seconds: float) -> bool:
        """Take or keep a named lease; False while someone else holds it."""
