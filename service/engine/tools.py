"""What the engine works with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from service.ports import ExecutorRegistry, FileStore, JobLog, JobStore, Plan, StepQueue, StepRunner
from service.settings import Settings


@dataclass(frozen=True)
class Tools:
    """Stores, queue, plans and the runner of steps."""

    settings: Settings
    jobs: JobStore
    steps: StepQueue
    log: JobLog
    files: FileStore
    executors: ExecutorRegistry
    runner: StepRunner
    plans: Mapping[str, Plan]
    count_results: Callable[[str], None]
    """Notes how much a job has stored."""
