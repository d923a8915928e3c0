"""What the engine works with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from service.ports import ExecutorRegistry, FileStore, JobLog, JobStore, Plan, StepRecords, StepRunner, StepSource
from service.settings import Settings


@dataclass(frozen=True)
class Tools:
    """Stores, source of steps, plans and the runner of steps."""

    settings: Settings
    jobs: JobStore
    steps: StepRecords
    source: StepSource
    log: JobLog
    files: FileStore
    executors: ExecutorRegistry
    runner: StepRunner
    plans: Mapping[str, Plan]
    count_results: Callable[[str], None]
    """Notes how much a job has stored."""
