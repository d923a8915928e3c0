"""A PostgreSQL server of one's own for tests: on a free port, in a temporary directory, gone at the end."""

import ctypes
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import psycopg
import pytest

from tests.measures.patience import patience

USER = "postgres"
START_WITHIN_S = 30.0


def programs() -> Path | None:
    """Find the folder of the newest PostgreSQL server that is installed."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    if found:
        return found[-1].parent
    on_path = shutil.which("initdb")
    return Path(on_path).resolve().parent if on_path else None


class PostgresServer:
    """A server that can be stopped, killed and started again.

    It refuses to run as root, so it gets a user of its own then; what it has committed survives its own death, but not
    that of the machine, which makes it fast.
    """

    def __init__(self, programs: Path, **options: str) -> None:
        self._programs = programs
        self._options = options
        self._user = {"user": USER, "group": USER, "extra_groups": []} if os.geteuid() == 0 else {}
        self._home = Path(tempfile.mkdtemp(prefix="tieline-postgres-"))
        self._process: subprocess.Popen[bytes] | None = None
        self._password = secrets.token_hex(8)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = probe.getsockname()[1]
        secret = self._home / "password"
        secret.write_text(self._password)
        if self._user:
            for path in (self._home, secret):
                shutil.chown(path, USER, USER)
        options = ["--username=tieline", f"--pwfile={secret}", "--auth=scram-sha-256", "--encoding=UTF8", "--no-sync"]
        self._run("initdb", f"--pgdata={self._home / 'data'}", "--locale=C", *options)

    def start(self) -> None:
        """Start it, and wait until it answers."""
        deadline = time.monotonic() + START_WITHIN_S * patience()
        settings = {
            "listen_addresses": "127.0.0.1",
            "port": str(self._port),
            "unix_socket_directories": str(self._home),
            "fsync": "off",
            **self._options,
        }
        words = [word for name, value in settings.items() for word in ("-c", f"{name}={value}")]
        while True:
            with (self._home / "log").open("ab") as log:
                self._process = subprocess.Popen(
                    [self._programs / "postgres", "-D", self._home / "data", *words],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,
                    cwd=self._home,
                    preexec_fn=_end_with_the_tests,  # noqa: PLW1509 - one call into the kernel
                    **self._user,  # type: ignore[call-overload]
                )
            # after a kill, memory that the old server's last processes hold may keep a new one from starting at first
            while self._process.poll() is None:
                with suppress(psycopg.OperationalError):
                    psycopg.connect(self.url("postgres"), connect_timeout=2).close()
                    return
                assert time.monotonic() < deadline, self.log
                time.sleep(0.05)
            assert time.monotonic() < deadline, self.log
            time.sleep(0.1)

    @property
    def log(self) -> str:
        return (self._home / "log").read_text()[-3000:]

    def url(self, database: str) -> str:
        return f"postgresql://tieline:{self._password}@127.0.0.1:{self._port}/{database}"

    def new_database(self) -> str:
        """Make an empty database; give its address."""
        name = f"tieline_{secrets.token_hex(4)}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return self.url(name)

    def connections(self) -> int:
        """Count the connections of others."""
        query = (
            "SELECT count(*) FROM pg_stat_activity WHERE backend_type = 'client backend' AND pid <> pg_backend_pid()"
        )
        with psycopg.connect(self.url("postgres")) as connection:
            row = connection.execute(query).fetchone()
        assert row is not None
        return int(row[0])

    def transactions(self, url: str) -> int:
        """Count the transactions in a database so far."""
        with psycopg.connect(self.url("postgres")) as connection:
            query = "SELECT xact_commit + xact_rollback FROM pg_stat_database WHERE datname = %s"
            row = connection.execute(query, [url.rpartition("/")[2]]).fetchone()
        assert row is not None
        return int(row[0])

    def stop(self) -> None:
        """Stop it in order, but without waiting for its clients."""
        if self._process is not None:
            self._process.send_signal(signal.SIGINT)
            self._process.wait(30.0 * patience())
            self._process = None

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Stop all its processes where they are; they go on afterwards."""
        family = self._family()
        for process in family:
            with suppress(psutil.NoSuchProcess):
                process.suspend()
        try:
            yield
        finally:
            for process in family:
                with suppress(psutil.NoSuchProcess):
                    process.resume()

    def kill(self) -> None:
        """End it and all its processes at once."""
        assert self._process is not None
        family = self._family()
        for process in family:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self._process.wait()
        psutil.wait_procs(family, 5.0)
        self._process = None

    def _family(self) -> list[psutil.Process]:
        assert self._process is not None
        return [psutil.Process(self._process.pid), *psutil.Process(self._process.pid).children(recursive=True)]

    def remove(self) -> None:
        """Stop it and remove all it has written."""
        self.stop()
        shutil.rmtree(self._home)

    def _run(self, program: str, *words: str) -> None:
        done = subprocess.run(
            [self._programs / program, *words],
            capture_output=True,
            text=True,
            check=False,
            cwd=self._home,
            **self._user,  # type: ignore[call-overload]
        )
        assert done.returncode == 0, done.stderr


def _end_with_the_tests() -> None:
    """Ask the kernel to stop the server when the tests are killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGINT, 0, 0, 0)


@contextmanager
def postgres_server(**options: str) -> Iterator[PostgresServer]:
    """Run a server, with options of its own; the test is skipped where none is installed."""
    found = programs()
    if found is None:
        pytest.skip("no PostgreSQL server is installed (package postgresql)")
    server = PostgresServer(found, **options)
    try:
        server.start()
        yield server
    finally:
        server.remove()
