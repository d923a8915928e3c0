"""The steps of all jobs as they are kept: which wait, which are computed, and what came out."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from service.ports.documents import Json
from service.ports.steps import StepCall


@dataclass(frozen=True)
class StepPlace:
    """One step of one job."""

    job_id: str
    stage: int
    index: int


@dataclass(frozen=True)
class ClaimedStep:
    """A step whose turn it is, and that one worker has now."""

    place: StepPlace
    name: str
    arguments: Json
    label: str
    request_id: str
    """Correlation id of the request that made the job."""
    deaths: float
    """Workers that died while they computed it."""

    @property
    def suspect(self) -> bool:
        """Check whether it may take its worker down, so that nothing else is computed there meanwhile."""
        return self.deaths >= 1.0


@dataclass(frozen=True)
class LostStep:
    """A step whose worker is gone."""

    place: StepPlace
    executor_id: str


@dataclass(frozen=True)
class LeftBehind:
    """What workers that are gone have left."""

    steps: Sequence[LostStep]
    jobs: Sequence[str]
    """Those whose stage has ended, and nobody has looked what comes next."""


@dataclass(frozen=True)
class StepFigures:
    """How it stands with steps, and what was computed since the service was set up."""

    waiting: int
    running: int
    longest_wait_s: float
    """Of those that wait."""
    totals: Mapping[str, Mapping[str, float]]
    """By name and label: ``step_seconds``, ``step_wait_seconds``, ``steps`` by name of the step, ``job_failures`` by
    kind, ``deaths`` of workers that computed."""


class StepRecords(Protocol):
    """Keep steps and what comes of them. Every method is one transaction; times are those of the database machine."""

    def plan_stage(self, job_id: str, stage: int, calls: Sequence[StepCall], total_weight: float) -> None:
        """Let the steps of a stage wait; doing so again changes nothing."""

    def outputs(self, job_id: str) -> Sequence[Sequence[Json]] | None:
        """Return the outputs of all stages; None while a step waits or is computed."""

    def begin_step(self, place: StepPlace, executor_id: str, now: datetime) -> ClaimedStep | None:
        """Let a worker have a step that it was given, and mark its job as running; again, when the answer was lost.

        None when the step is over, when another worker has it, and when the worker was taken for dead.
        """

    def report_step(self, place: StepPlace, executor_id: str, fraction: float, message: str, now: datetime) -> bool:
        """Record how far a step is; False when the job is gone or final, or another worker has the step."""

    def finish_step(self, place: StepPlace, executor_id: str, output: Json, now: datetime) -> bool:
        """Record what came out; False as for `report_step`."""

    def hand_back(self, executor_id: str, kept: Collection[StepPlace] = ()) -> None:
        """Put back what a worker has and does not compute, or will not."""

    def tidy(self, now: datetime, *, by_heart: bool = True) -> LeftBehind:
        """Find what workers that are gone have left, and mark jobs as waiting of which no step has run for a while.

        Not `by_heart` when hearts may have beaten that could not be heard.
        """

    def put_back(self, lost: LostStep, death: float, now: datetime) -> float:
        """Let another worker compute a step whose worker is gone; give how many have died of it by now.

        Parameters
        ----------
        lost
            The step.
        death
            How much the end of the worker counts.
        now
            Time for the job's record.
        """

    def begin_stale_again(self) -> Sequence[str]:
        """Forget the steps of jobs that were planned in another order of steps, unless a living worker computes one."""

    def figures(self) -> StepFigures:
        """Return what Prometheus is told."""
