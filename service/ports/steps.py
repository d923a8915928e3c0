"""Plans of jobs, and the steps that they consist of."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO, Protocol

from service.errors import ComputationFailedError, ServiceError
from service.ports.blobs import StepFiles
from service.ports.documents import Json
from service.ports.sources import Sources


@dataclass(frozen=True)
class StepCall:
    """One computation that runs in a process of its own."""

    name: str
    """Name of the step, e.g. ``features``."""
    arguments: Json
    """Small JSON: ids, options, keys of blobs; never arrays."""
    label: str
    """What a person reads while it runs, e.g. ``features of S1``."""
    weight: float = 1.0
    """Share of the job's progress relative to the other steps."""


class StepProgress(Protocol):
    """Receive the progress of one step."""

    def report(self, fraction: float, message: str) -> None:
        """Say that `fraction` (0..1) of the step is done."""


class Plan(Protocol):
    """Turn a job's inputs into stages of steps. Deterministic: the same outputs give the same next stage."""

    def next_stage(self, job: Json, outputs: Sequence[Sequence[Json]]) -> Sequence[StepCall] | None:
        """Give the next stage.

        Parameters
        ----------
        job
            ``{"id", "process_id", "inputs", "files", "created"}``; ``files`` maps the id of each file that the job
            reads to its ``{"name", "sha256"}``. ``wanted`` is there when outputs that are files are wanted: how, by
            name of each.
        outputs
            The outputs of each finished stage, in the order of its calls.

        Returns
        -------
        Steps that may run side by side, or None when all is done. The last stage writes ``jobs/<id>/result.json``.
        """

    def total_weight(self, job: Json) -> float:
        """Estimate the sum of the weights of all stages, those not planned yet included; progress is a share of it."""


@dataclass(frozen=True)
class StepContext:
    """What a step may use besides its arguments."""

    blobs: StepFiles
    progress: StepProgress
    limits: Mapping[str, int] = field(default_factory=dict)
    sources: Sources | None = None
    """Files on other servers; None: out of reach."""


class StepFailedError(ServiceError):
    """Carry the problem document of a step that failed in another process, unchanged.

    Parameters
    ----------
    problem
        Becomes the answer of `service.errors.to_problem` as it is.
    """

    def __init__(self, problem: Json) -> None:
        self.problem = problem
        super().__init__(str(problem.get("detail") or problem["title"]))

    @property
    def broke_down(self) -> bool:
        """Tell whether it ran out of time or memory, and found no fault in what it was given."""
        return bool(self.problem["title"] == ComputationFailedError.title)

    def extra(self) -> Json:
        """Give the whole document."""
        return self.problem


class StepRunner(Protocol):
    """Run one step in a process of its own, with limits."""

    async def run(
        self, step: str, arguments: Json, *, timeout_s: float, on_progress: Callable[[float, str], None] | None = None
    ) -> Json:
        """Give the step's output.

        Cancelling the awaiting task kills the process and all it started.

        Raises
        ------
        StepFailedError
            The step itself reported what is wrong, or took longer than `timeout_s`; trying again would not help.
        ComputationFailedError
            The process died without a report; the message tells how, and its last words.
        """


class RequestReader(Protocol):
    """Read a request in a process of its own, with limits: what it says may be hostile, and is large."""

    async def read(self, step: str, arguments: Json, body: BinaryIO, *, timeout_s: float) -> tuple[Json, bytes]:
        """Return the output of a step, and the bytes that it made of a body.

        The step finds the body as the blob `REQUEST_BODY`, and makes the blob `REQUEST_INPUTS`.

        Raises
        ------
        StepFailedError, ComputationFailedError
            As `StepRunner.run` says.
        """


REQUEST_BODY, REQUEST_INPUTS = "request/body", "request/inputs"
