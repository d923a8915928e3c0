"""A worker: executes jobs until it is told to stop. `python -m service.worker`."""

import argparse
import fcntl
import importlib
import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import cast

import sqlalchemy as sa
import structlog

from service.adapters.database.callbacks import DatabaseCallbacks
from service.adapters.database.executors import DatabaseExecutors
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.job_log import DatabaseJobLog
from service.adapters.database.jobs import DatabaseJobStore
from service.adapters.database.steps import DatabaseSteps
from service.adapters.database.tables import FRESH_FOR_WORKERS_S, connect
from service.adapters.database.turns import DatabaseTurns
from service.adapters.files.object_files import blob_store
from service.adapters.outgoing.callback_thread import CallbackThread
from service.adapters.outgoing.http_callbacks import HttpCallbacks
from service.adapters.processes.child_process import NOTHING_WARM, ChildProcesses, remove_left_scratch
from service.adapters.processes.log_output import configure_log
from service.adapters.processes.nursery_client import WarmUp
from service.adapters.processes.process_limits import DEFAULT_STEPS, die_with_parent
from service.adapters.processes.signal_pipe import SignalPipe
from service.adapters.uploads.shared_uploads import upload_store_of
from service.engine import ClaimedSteps, Engine, Tools
from service.engine.patience import patiently
from service.errors import ServiceError, StorageError
from service.ports import BlobStore, Plan, StepSource
from service.processes import OFFERED_PROCESSES
from service.settings import Settings
from service.use_cases.callbacks.deliver_callbacks import CallbackDelivery
from service.use_cases.limits.quotas import Belongings, count_results
from service.use_cases.steps.fetch_runner import FetchingRunner
from service.use_cases.uploads.clean_up import remove_half_made
from service.use_cases.uploads.store_files import FileIntake

log = structlog.get_logger()
DEFAULT_PLANS = "service.processes:PLANS"
STOP_WITHIN_S = 6.0
"""Less than the launcher waits. Longer than it takes, but when the database is away."""
WAITS_FOR_ANOTHER_S = 3.0
LOCK = "worker.lock"
STOPPING = frozenset((signal.SIGTERM, signal.SIGINT))
WARM_UP = WarmUp(
    "service.use_cases.steps.warm_up:load_for_registration",
    "service.use_cases.steps.warm_up:load_for_reports",
    "service.use_cases.steps.kernels:compile_common_kernels",
    "service.use_cases.steps.kernels:load_common_kernels",
    "service.use_cases.steps.kernels:compile_other_kernels",
)


def main(
    settings: Settings,
    slot: str = "worker",
    *,
    steps: str = DEFAULT_STEPS,
    plans: str = DEFAULT_PLANS,
    launcher: int | None = None,
) -> None:
    """Execute jobs until SIGTERM or SIGINT; then give running steps up, to be resumed elsewhere or at the next start.

    The database must have been prepared (`service.launcher.prepare`).
    """
    signals = SignalPipe(*STOPPING, signal.SIGCONT)
    configure_log()
    with _the_only_one(settings):
        _work(settings, signals, slot, steps=steps, plans=plans, launcher=launcher)


def _work(settings: Settings, signals: SignalPipe, slot: str, *, steps: str, plans: str, launcher: int | None) -> None:
    remove_left_scratch(settings)
    database = connect(settings, fresh_s=FRESH_FOR_WORKERS_S)
    executors = DatabaseExecutors(database)
    jobs = DatabaseJobStore(database)
    runner = ChildProcesses(settings, blob_store, steps, WARM_UP if steps == DEFAULT_STEPS else NOTHING_WARM)
    runner.warm_up()
    module, _, attribute = plans.partition(":")
    files, blobs = DatabaseFileStore(database), blob_store(settings)
    _remove_half_made(blobs, settings)
    belongings = Belongings(files, jobs, upload_store_of(settings, database, blobs))
    intake = FileIntake(belongings, blobs, runner, settings)
    steps_kept = DatabaseSteps(database)
    tools = Tools(
        settings=settings,
        jobs=jobs,
        steps=steps_kept,
        source=source_of(settings, database, steps_kept),
        log=DatabaseJobLog(database),
        files=files,
        executors=executors,
        runner=FetchingRunner(runner, intake, jobs, OFFERED_PROCESSES, partial(patiently, settings.step_timeout_s)),
        plans=cast("Mapping[str, Plan]", getattr(importlib.import_module(module), attribute)),
        count_results=partial(count_results, jobs=jobs, files=files, blobs=blobs),
    )
    engine = Engine(tools, slot, launcher)
    callbacks = CallbackThread(
        CallbackDelivery(
            callbacks=DatabaseCallbacks(database),
            jobs=jobs,
            blobs=blobs,
            log=tools.log,
            sender=HttpCallbacks(settings),
            settings=settings,
            holder=engine.executor_id,
        )
    )
    engine.start()
    callbacks.start()
    while not (told := signals.wait()) & STOPPING:
        if signal.SIGCONT in told:
            engine.wake()
    last_resort = threading.Timer(STOP_WITHIN_S, _leave)
    last_resort.daemon = True
    last_resort.start()
    callbacks.stop()
    engine.stop()
    runner.close()
    database.dispose()


def source_of(settings: Settings, database: sa.Engine, steps: DatabaseSteps) -> StepSource:
    """Return what brings a worker its steps."""
    if settings.gives_steps:
        from service.adapters.procrastinate.worker import GivenSteps

        return GivenSteps(settings, steps)
    return ClaimedSteps(settings, DatabaseTurns(database, settings.max_running_jobs), steps)


@contextmanager
def _the_only_one(settings: Settings) -> Iterator[None]:
    """Keep a second worker off an embedded database, and wait a moment for one that is just ending.

    Raises
    ------
    StorageError
        Another worker lives.
    """
    if not settings.embedded_database:
        yield
        return
    with (settings.data_dir / LOCK).open("ab") as lock:  # the kernel opens it when this process is gone
        deadline = time.monotonic() + WAITS_FOR_ANOTHER_S
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    text = f"another worker uses {settings.data_dir.resolve()}; several need PostgreSQL"
                    raise StorageError(text) from None
            time.sleep(0.1)
        yield


def _remove_half_made(blobs: BlobStore, settings: Settings) -> None:
    """Remove what killed processes left on this machine, where perhaps no API process does it."""
    try:
        remove_half_made(blobs, datetime.now(UTC) - timedelta(seconds=settings.upload_expiry_s))
    except (ServiceError, OSError) as error:
        log.warning("what is half-made cannot be removed", error=str(error))


def _leave() -> None:
    """End this process, and computations with it; what is left is taken up as after its death."""
    log.warning("stopping takes too long: what is left is for others to take up")
    os._exit(os.EX_TEMPFAIL)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="service.worker", description="Execute jobs until told to stop.")
    parser.add_argument("--slot", default="worker")
    parser.add_argument("--steps", default=DEFAULT_STEPS)
    parser.add_argument("--plans", default=DEFAULT_PLANS)
    parser.add_argument("--parent", type=int, help="process id of the launcher, with which the worker ends")
    options = parser.parse_args()
    if options.parent is not None:
        die_with_parent(options.parent)
    main(Settings(), options.slot, steps=options.steps, plans=options.plans, launcher=options.parent)
