"""Keep the processes of the service running until told to stop: what `tieline serve` becomes when all is prepared.

It does nothing but wait for as long as the service runs, so it imports none of what preparing needs.
"""

import argparse
import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from service.adapters.processes.signal_pipe import SignalPipe

CHECK_INTERVAL_S = 0.2
STOP_WITHIN_S = 8.0
LONGEST_BACK_OFF_S = 30.0
STEADY_AFTER_S = 10.0
"""A process that lived so long is restarted at once when it dies."""
STOPPED_FOR_S = 6.0
"""Longest time for which a process may be stopped; then it is killed, as it may be in the middle of a transaction.
Other workers take it for dead by then [s]."""


@dataclass
class Supervised:
    """One process that is to run all the time."""

    name: str
    command: Sequence[str]
    descriptors: Sequence[int] = ()
    """Open files of this process that it needs."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Variables besides those of this process."""
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    next_start: float = 0.0
    failures: int = field(default=0)
    stopped_since: float | None = None

    def keep_running(self) -> None:
        """Start it when it does not run; wait longer after each quick death. Kill it when it stays stopped."""
        now = time.monotonic()
        if self.process is not None and self.process.poll() is None:
            self._kill_when_stopped(self.process, now)
        if self.process is not None and self.process.poll() is not None:
            lived = now - self.started
            self.failures = 0 if lived > STEADY_AFTER_S else self.failures + 1
            self.next_start = now + (0.0 if self.failures == 0 else min(0.5 * 2**self.failures, LONGEST_BACK_OFF_S))
            note(
                "process ended",
                "warning",
                name=self.name,
                code=self.process.returncode,
                restart_s=self.next_start - now,
            )
            self.process = None
        if self.process is None and now >= self.next_start:
            self.started = now
            self.process = subprocess.Popen(  # noqa: S603 - our own modules
                self.command,
                env={**os.environ, **self.environment},
                pass_fds=self.descriptors,
                start_new_session=True,
            )
            note("process started", name=self.name, pid=self.process.pid)

    def _kill_when_stopped(self, process: subprocess.Popen[bytes], now: float) -> None:
        if not _is_stopped(process.pid):
            self.stopped_since = None
            return
        self.stopped_since = self.stopped_since or now
        if now - self.stopped_since > STOPPED_FOR_S:
            note("process is stopped and is killed", "warning", name=self.name, pid=process.pid)
            self.stopped_since = None
            process.kill()


def supervise(supervised: Sequence[Supervised], host: str, port: int) -> None:
    """Run them until SIGTERM, SIGINT or SIGHUP; then stop all within 10 s.

    Where SIGHUP is ignored, as `nohup` does, it stays so.
    """
    hangs_up = () if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else (signal.SIGHUP,)
    signals = SignalPipe(signal.SIGTERM, signal.SIGINT, *hangs_up)
    stop = threading.Event()
    announcer = threading.Thread(target=_announce_when_ready, args=(host, port, stop), daemon=True)
    announcer.start()
    try:
        told: frozenset[int] = frozenset()
        while not told:
            for each in supervised:
                each.keep_running()
            told = signals.wait(CHECK_INTERVAL_S)
    finally:
        stop.set()
        _stop_all([each.process for each in supervised if each.process is not None])
    note("service stopped")


def note(event: str, level: str = "info", **values: Any) -> None:
    """Write to the log in the form of all other processes, `service.adapters.processes.log_output`."""
    line = {**values, "event": event, "level": level, "logger": "service.supervisor"}
    line["timestamp"] = datetime.now(UTC).isoformat().replace("+00:00", "Z")
    text = " ".join(map(str, (level, event, values or ""))) if sys.stderr.isatty() else json.dumps(line)
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def _stop_all(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """Ask all to stop, and kill those that do not in time."""
    for process in processes:
        process.terminate()
    deadline = time.monotonic() + STOP_WITHIN_S
    for process in processes:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            note("process did not stop in time and is killed", "warning", pid=process.pid)
            process.kill()
            process.wait()


def _is_stopped(pid: int) -> bool:
    """Check whether a child is stopped, as by SIGSTOP; where the system does not say so, it is not."""
    if not hasattr(os, "waitid"):
        return False
    try:
        return os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:  # it has ended since
        return False


def _announce_when_ready(host: str, port: int, stop: threading.Event) -> None:
    """Print the address once the service answers that it is ready."""
    while not stop.wait(CHECK_INTERVAL_S):
        connection = http.client.HTTPConnection(host, port, timeout=2.0)
        try:
            connection.request("GET", "/readyz")
            if connection.getresponse().status == http.client.OK:
                sys.stdout.write(f"Tieline is ready at http://{host}:{port}\n")
                sys.stdout.flush()
                return
        except (OSError, http.client.HTTPException):
            continue
        finally:
            connection.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="service.supervisor", description="Keep processes running (for tieline serve)."
    )
    parser.add_argument("--host", required=True)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--process", action="append", required=True, help="one of them, in JSON")
    options = parser.parse_args()
    supervise([Supervised(**json.loads(each)) for each in options.process], options.host, options.port)
