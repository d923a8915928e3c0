"""Run the whole service for as long as one command needs it."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service.client import RefusedError, ServiceClient, UnreachableError
from service.use_cases.access.service_proof import secret_of

START_WITHIN_S = 600.0
"""As long as its process lives: on a machine that is busy with other things it may take minutes."""
STOP_WITHIN_S = 20.0


@contextmanager
def embedded_service() -> Iterator[str]:
    """Start the service on a free port with a temporary data directory; give its address; stop and remove it all.

    Raises
    ------
    UnreachableError
        It did not come up; the end of its log is in the message.
    """
    with tempfile.TemporaryDirectory(prefix="tieline-", ignore_cleanup_errors=True) as folder:
        log = Path(folder) / "service.log"
        port = _free_port()
        url = f"http://127.0.0.1:{port}"
        command = [sys.executable, "-P", "-m", "service", "serve", "--port", str(port), "--data-dir", f"{folder}/data"]
        with log.open("wb") as output:
            process = subprocess.Popen(  # noqa: S603 - our own module; it is ours alone, without keys, and we wait
                command,
                env={**os.environ, "TIELINE_AUTH": "auto", "TIELINE_NICENESS": "0"},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        try:
            _wait_until_ready(url, process, log, Path(folder) / "data")
            yield url
        except RefusedError as error:
            if error.status >= 500:  # the log goes with the folder
                error.add_note(f"The end of the service's log:\n{_end_of(log)}")
            raise
        finally:
            _stop(process)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _wait_until_ready(url: str, process: "subprocess.Popen[bytes]", log: Path, data: Path) -> None:
    """Wait until what answers is the service that was started, and not who took its port before it could."""
    deadline = time.monotonic() + START_WITHIN_S
    with ServiceClient(url) as client:
        while not (client.ready() and client.proves(secret_of(data))):
            if process.poll() is not None or time.monotonic() > deadline:
                raise UnreachableError(url, f"the embedded service did not start. The end of its log:\n{_end_of(log)}")
            time.sleep(0.2)


def _end_of(log: Path) -> str:
    return log.read_text(errors="replace")[-3000:]


def _stop(process: "subprocess.Popen[bytes]") -> None:
    """Ask the service to stop; after a while end whatever of its session is left."""
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            process.wait(STOP_WITHIN_S)
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
