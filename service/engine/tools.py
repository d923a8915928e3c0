"""What the engine works with."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from service.engine.queue import DbosQueue
from service.ports import ExecutorRegistry, FileStore, JobLog, JobStore, Plan, StepLedger, StepRunner
from service.settings import Settings


@dataclass(frozen=True)
class Tools:
    """Stores, queue, plans and the runner of steps."""

    settings: Settings
    jobs: JobStore
    ledger: StepLedger
    log: JobLog
    files: FileStore
    executors: ExecutorRegistry
    runner: StepRunner
    plans: Mapping[str, Plan]
    queue: DbosQueue
    count_results: Callable[[str], None]
    """Notes how much a job has stored."""
