"""How steps come to a worker: some queues are asked, others give."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from service.ports.job_steps import ClaimedStep


@dataclass(frozen=True)
class FreshJob:
    """A job whose turn it is, and of which no step is known yet."""

    id: str


class Turns(Protocol):
    """Hand out steps in order to who asks. Every method is one transaction."""

    def look(self) -> bool:
        """Check whether anything waits, as cheaply as possible."""

    def take_turn(self, executor_id: str, now: datetime, *, alone: bool) -> ClaimedStep | FreshJob | None:
        """Claim the step whose turn it is, and mark its job as running, or tell which job is to be begun.

        None when nothing waits but what others begin, or when the next step wants to be alone on its worker and is not.
        """


@dataclass(frozen=True)
class StepWork:
    """What a worker does with what it is given. Both may be done twice, and be cancelled."""

    compute: Callable[[ClaimedStep], Awaitable[bool]]
    """Compute a step that this worker has, and lead its job on; False when it is not known what was recorded."""
    lead: Callable[[str], Awaitable[None]]
    """Put on the queue what comes next of a job, or end it, unless one of its steps waits or is computed."""
    require_life: Callable[[], Awaitable[None]]
    """End this process if others took it for dead, and compute its steps already."""


class StepSource(Protocol):
    """Bring a worker its steps, as many as it has slots, from its start to its end."""

    async def run(self, executor_id: str, work: StepWork) -> None:
        """Let steps be computed until told to stop; then cancel what is computed and wait for its end."""

    def stop(self) -> None:
        """End `run`, from any thread."""
