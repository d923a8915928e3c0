"""`tieline serve`: prepare the database, then become what keeps API and worker processes running."""

import argparse
import fcntl
import ipaddress
import json
import os
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import sqlalchemy as sa
import structlog
import uvicorn
from sqlalchemy.exc import OperationalError

from algorithms.scans.open3d_loading import missing_for_open3d
from service.adapters.database.callbacks import seal_old_secrets
from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.jobs import let_shrink, migrate
from service.adapters.database.keys import DatabaseKeyStore
from service.adapters.database.tables import connect
from service.adapters.files.local_files import LocalFiles
from service.adapters.processes.child_process import remove_left_scratch
from service.adapters.processes.log_output import configure_log
from service.adapters.processes.process_limits import DEFAULT_STEPS, die_with_parent
from service.adapters.web.impatient_server import ImpatientConnection, allow_many_files
from service.errors import StorageError
from service.names.content_keys import INCOMING
from service.refusals import OpenToAllError
from service.settings import Settings
from service.use_cases.access.sealed_secrets import seal_of
from service.use_cases.access.service_proof import LOCK, new_secret
from service.use_cases.limits.check_readiness import NEEDING_OPEN3D
from service.use_cases.uploads.adopt_files import adopt_files

DEFAULT_PLANS = "service.processes:PLANS"
DEFAULT_APP = "service.main:app_from_environment"
THREAD_SWITCH_S = 0.0005
"""How long a thread of an API process may keep the others waiting: with the usual 5 ms a request that needs two threads
takes ten times as long where others are answered."""
ALLOCATION = {"MALLOC_ARENA_MAX": "2", "MALLOC_MMAP_THRESHOLD_": "262144"}
"""Else each of some dozens of threads keeps memory for itself, and large blocks stay when they are free."""
COUNTS = "PROMETHEUS_MULTIPROC_DIR"
COUNTS_BYTES = 1 << 19
"""Room for the counts of one kind: of some two thousand series, and the interface has a few hundred."""
log = structlog.get_logger()


def keep_private(settings: Settings) -> None:
    """Let nobody else on this machine read what this process and those that it starts write."""
    os.umask(0o077)
    settings.data_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    try:
        settings.data_dir.chmod(0o700)
    except PermissionError:  # of another user, who lets this one write there
        log.warning("others may read the data directory", directory=str(settings.data_dir))
    (settings.data_dir / LOCK).touch(mode=0o600)


def prepare(settings: Settings) -> None:
    """Bring the data up to date: the tables, the files. Before any process starts.

    Raises
    ------
    StorageError
        The database cannot be reached.
    """
    keep_private(settings)
    try:
        migrate(settings)
    except OperationalError as error:
        place = sa.make_url(settings.sqlalchemy_url).render_as_string(hide_password=True)
        raise StorageError(f"the database {place} cannot be used: {error.orig}") from None
    tables = connect(settings)
    seal_old_secrets(tables, seal_of(settings))
    if not settings.storage_url:
        adopt_files(DatabaseFileStore(tables), LocalFiles(settings.data_dir))
    tables.dispose()


def serve(
    settings: Settings, *, steps: str = DEFAULT_STEPS, plans: str = DEFAULT_PLANS, app: str = DEFAULT_APP
) -> NoReturn:
    """Run the service until SIGTERM or SIGINT; stop all its processes within 10 s.

    This process prepares all, and then executes `service.supervisor` in its place, which needs a fifth of its memory.

    Raises
    ------
    StorageError
        The data directory is in use by another service.
    OSError
        The address cannot be bound.
    OpenToAllError
        Others could reach it, and it asks for no keys.
    """
    configure_log()
    keep_private(settings)
    with _only_one(settings) as lock, _listening_in_safety(settings) as listener:
        _remove_partial(settings)
        if (missing := missing_for_open3d()) is not None:
            log.warning("some processes cannot run here", why=str(missing), processes=NEEDING_OPEN3D)
        processes = _processes(settings, listener, steps, plans, app)
        place = ("--host", settings.host, "--port", str(listener.getsockname()[1]))
        told = (word for each in processes for word in ("--process", json.dumps(each)))
        for descriptor in (lock, listener.fileno()):
            os.set_inheritable(descriptor, True)
        sys.stdout.flush()
        sys.stderr.flush()
        command = [sys.executable, "-P", "-m", "service.supervisor", *place, *told]
        os.execve(sys.executable, command, _environment(settings))  # noqa: S606 - our own module


@contextmanager
def _only_one(settings: Settings) -> Iterator[int]:
    """Keep a second service off the same data directory, as long as the descriptor is open that is given."""
    with (settings.data_dir / LOCK).open("ab") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StorageError(f"another service uses the data directory {settings.data_dir.resolve()}") from None
        os.fchmod(lock.fileno(), 0o600)
        lock.truncate(0)
        lock.write(new_secret())
        lock.flush()
        yield lock.fileno()


@contextmanager
def _listening_in_safety(settings: Settings) -> Iterator[socket.socket]:
    """Bind when it is known that not everybody is let in."""
    prepare(settings)
    let_shrink(settings)
    tables = connect(settings)
    try:
        if settings.auth == "auto" and not _is_loopback(settings.host) and not DatabaseKeyStore(tables).known():
            raise OpenToAllError(settings.host)
    finally:
        tables.dispose()
    with _listening(settings) as listener:
        yield listener


def _is_loopback(host: str) -> bool:
    """Tell whether only this machine reaches an address."""
    if not host:
        return False
    found = socket.getaddrinfo(host, None)
    return all(ipaddress.ip_address(address[4][0]).is_loopback for address in found)


@contextmanager
def _listening(settings: Settings) -> Iterator[socket.socket]:
    """Bind once, here: an API process that dies loses no connection that is not accepted yet."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((settings.host, settings.port))
        # what is accepted inherits it: else the second answer of a connection waits 40 ms for the client's receipt
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        listener.listen(2048)
        yield listener


def _remove_partial(settings: Settings) -> None:
    """Remove what a service that was killed left half-written."""
    remove_left_scratch(settings)
    LocalFiles(settings.data_dir).delete_prefix(INCOMING)
    for path in (settings.data_dir / "scratch").glob("partial-*"):
        path.unlink(missing_ok=True)


def _processes(settings: Settings, listener: socket.socket, steps: str, plans: str, app: str) -> list[dict[str, Any]]:
    """Name the processes of the service, as `service.supervisor.Supervised` has them."""
    parent = ("--parent", str(os.getpid()))
    descriptor = listener.fileno()
    api = (sys.executable, "-P", "-m", "service.launcher", "--descriptor", str(descriptor), "--app", app, *parent)
    worker = (sys.executable, "-P", "-m", "service.worker", "--steps", steps, "--plans", plans, *parent)
    of_api = {"command": api, "descriptors": [descriptor], "environment": ALLOCATION}
    return [
        *({"name": f"api-{i}", **of_api} for i in range(settings.api_processes)),
        *({"name": f"worker-{i}", "command": (*worker, "--slot", str(i))} for i in range(settings.workers)),
    ]


def _environment(settings: Settings) -> dict[str, str]:
    """Let all processes read the same settings."""
    environment = dict(os.environ)
    for name, value in settings.model_dump(mode="json").items():
        environment[f"TIELINE_{name.upper()}"] = value if isinstance(value, str) else json.dumps(value)
    counts = settings.data_dir.resolve() / "metrics"
    shutil.rmtree(counts, ignore_errors=True)  # of processes that are no more
    counts.mkdir(parents=True)
    return {**environment, COUNTS: str(counts)}


def _run_api(descriptor: int, app: str) -> None:
    """Serve the web application on a socket that the launcher has bound."""
    configure_log()
    sys.setswitchinterval(THREAD_SWITCH_S)
    allow_many_files()
    settings = Settings()
    _reserve_counts()
    # the web server itself would believe whatever comes from this machine
    proxies = settings.trusted_proxies or os.environ.get("FORWARDED_ALLOW_IPS", "")
    uvicorn.run(
        app,
        factory=True,
        fd=descriptor,
        proxy_headers=bool(proxies),
        forwarded_allow_ips=proxies,
        http=ImpatientConnection.with_limits(settings.header_timeout_s, settings.body_timeout_s),
        log_config=None,
        access_log=False,
        timeout_graceful_shutdown=5,
    )


def _reserve_counts() -> None:
    """Reserve for the counts of requests their blocks on the disk.

    They are in files that are mapped into memory: a process that writes to one for which the disk has no block is
    killed. Where there are none now, this process counts for itself.
    """
    folder = os.environ.get(COUNTS)
    if folder is None:
        return
    paths = [Path(folder) / f"{kind}_{os.getpid()}.db" for kind in ("counter", "histogram", "summary")]
    try:
        for path in paths:
            with path.open("ab") as file:
                os.posix_fallocate(file.fileno(), 0, COUNTS_BYTES)
    except OSError as error:
        log.warning("there is no room for counts of requests, which /metrics does not have now", error=str(error))
        for path in paths:
            path.unlink(missing_ok=True)
        del os.environ[COUNTS]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="service.launcher", description="Run one API process (started by serve).")
    parser.add_argument("--descriptor", type=int, required=True)
    parser.add_argument("--app", default=DEFAULT_APP)
    parser.add_argument("--parent", type=int, required=True)
    options = parser.parse_args()
    die_with_parent(options.parent)
    _run_api(options.descriptor, options.app)
