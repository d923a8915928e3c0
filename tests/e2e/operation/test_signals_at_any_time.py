"""`tieline serve` is told to end at any time, also while it starts and many times over: it ends, and nothing stays."""

import fcntl
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import closing, suppress
from pathlib import Path

import psutil
import pytest

from service.use_cases.access.service_proof import LOCK
from tests.measures.patience import patience

pytestmark = pytest.mark.service

STARTS = 30
TOLD = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
LONGEST_START_S = 3.0
"""Within it falls most of what a start does."""
READY = b"Tieline is ready"
GRACE_S = 10.0
"""Within which `service.supervisor` stops all."""


def processes_of(home: Path) -> Sequence[psutil.Process]:
    """Find all that was started for a data directory, whoever their parents are, by their environment."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.NoSuchProcess, psutil.AccessDenied):
            if process.environ().get("TMPDIR") == str(home) and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def started(home: Path) -> subprocess.Popen[bytes]:
    with (home / "log").open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "service", "serve", "--port", "0", "--data-dir", str(home / "data")],
            env={**os.environ, "TMPDIR": str(home), "TIELINE_API_PROCESSES": "2"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            start_new_session=True,
        )


def locked(data: Path) -> str:
    """Tell what still keeps others off the data directory; nothing where it is free."""
    if not (data / LOCK).exists():
        return ""
    with (data / LOCK).open("ab") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return "the data directory is in use"
    if (data / "tieline.sqlite").exists():
        with closing(sqlite3.connect(data / "tieline.sqlite", timeout=0.0, isolation_level=None)) as database:
            try:
                database.execute("BEGIN IMMEDIATE")
            except sqlite3.OperationalError as error:
                return str(error)
            if database.execute("PRAGMA integrity_check").fetchone() != ("ok",):
                return "the database is damaged"
    return ""


@pytest.mark.parametrize("number", range(STARTS))
def test_it_ends_in_time_and_leaves_no_process_and_no_lock(
    tmp_path_factory: pytest.TempPathFactory, number: int
) -> None:
    chance = random.Random(number)
    # every third start finds an empty directory, and makes the tables; every fifth becomes ready
    home = tmp_path_factory.getbasetemp() / f"signals-{number // 3}"
    home.mkdir(exist_ok=True)
    with started(home) as running:
        try:
            assert running.stdout is not None
            if number % 5 == 0:
                assert running.stdout.readline().startswith(READY)
            time.sleep(chance.uniform(0.0, 0.2 if number % 5 == 0 else LONGEST_START_S))
            first = chance.choice(TOLD)
            running.send_signal(first)
            told = time.monotonic()
            for _ in range(chance.randrange(20)):
                time.sleep(chance.choice((0.0, 0.001, 0.05)))
                running.send_signal(chance.choice(TOLD))
            running.wait(GRACE_S * patience())
            print(f"start {number}: {first.name}, code {running.returncode}, {time.monotonic() - told:.2f} s")
            deadline = time.monotonic() + 1.0 * patience()
            while (left := processes_of(home)) and time.monotonic() < deadline:
                time.sleep(0.02)
            assert [" ".join(process.cmdline()) for process in left] == []
            assert locked(home / "data") == ""
        finally:
            running.kill()
