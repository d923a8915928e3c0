"""Run one step in a process of its own: `python -m service.child`."""

import asyncio
import contextlib
import hashlib
import json
import os
import secrets
import shutil
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import psutil
import structlog

from service.adapters.process_limits import DEFAULT_STEPS, this_host, threads_per_step
from service.errors import ComputationFailedError, to_problem
from service.ports import Json, StepFailedError
from service.settings import Settings

LAST_WORDS_LINES = 12
LINE_BYTES = 1 << 26
THREAD_VARIABLES = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Loops over points: as many threads as the step may use."""
SINGLE_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Matrices of some hundred rows: a second thread gains nothing on an idle machine and costs a factor on a busy one."""
log = structlog.get_logger()


@dataclass
class _Conversation:
    """What a child has said so far."""

    result: Json | None = None
    problem: Json | None = None
    words: deque[str] = field(default_factory=lambda: deque(maxlen=LAST_WORDS_LINES))
    doing: str = ""

    def last_words(self) -> str:
        """Give what it was doing and the end of what it printed."""
        said = "; ".join(line for line in self.words if line.strip())
        return ", ".join(
            part for part in (self.doing and f"while {self.doing}", said and f"last words: {said}") if part
        )


class ChildProcesses:
    """Run steps in child processes.

    Parameters
    ----------
    settings
        Limits, number of threads and place of the data; handed to the child.
    steps
        ``module:attribute`` of the mapping of step names to functions.
    """

    def __init__(self, settings: Settings, steps: str = DEFAULT_STEPS) -> None:
        self._settings = settings
        self._steps = steps
        self._scratch = settings.data_dir.resolve() / "scratch"
        self._scratch.mkdir(parents=True, exist_ok=True)

    async def run(
        self, step: str, arguments: Json, *, timeout_s: float, on_progress: Callable[[float, str], None] | None = None
    ) -> Json:
        """Give the step's output; see `service.ports.StepRunner`."""
        heard = _Conversation()
        directory = self._scratch / f"run-{_host_mark()}-{os.getpid()}-{secrets.token_hex(6)}"
        directory.mkdir()
        request = {
            "step": step,
            "arguments": arguments,
            "settings": self._settings.model_dump(mode="json"),
            "scratch": str(directory),
        }
        try:
            code = await self._converse(request, heard, timeout_s, on_progress or _ignore)
        except TimeoutError:
            error = ComputationFailedError(f"the computation took longer than {timeout_s:g} s and was stopped")
            raise StepFailedError(to_problem(error)) from None
        finally:
            shutil.rmtree(directory, ignore_errors=True)
        if heard.problem is not None:
            raise StepFailedError(heard.problem)
        if heard.result is None:
            raise ComputationFailedError(", ".join(filter(None, (_ending(code), heard.last_words()))))
        return heard.result

    async def _converse(
        self, request: Json, heard: _Conversation, timeout_s: float, on_progress: Callable[[float, str], None]
    ) -> int:
        """Start the child, listen until it ends; kill it and all it started whatever happens."""
        reports, writing_end = os.pipe()
        try:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "service.child"),
                *("--steps", self._steps, "--parent", str(os.getpid()), "--report-fd", str(writing_end)),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
                start_new_session=True,
                pass_fds=(writing_end,),
                limit=LINE_BYTES,
                env={**os.environ, **self._environment()},
            )
        except BaseException:
            os.close(reports)
            raise
        finally:
            os.close(writing_end)
        listeners = [
            asyncio.ensure_future(_listen(reports, heard, on_progress)),
            asyncio.ensure_future(_overhear(process, heard, str(request["step"]))),
        ]
        try:
            async with asyncio.timeout(timeout_s):
                await _send(process, request)
                return await process.wait()
        finally:
            # the group has the child's number, so grandchildren that hold a pipe open end too
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            await asyncio.shield(asyncio.gather(process.wait(), *listeners, return_exceptions=True))

    def _environment(self) -> Mapping[str, str]:
        """Set what must be known before the libraries are imported."""
        return {
            **dict.fromkeys(THREAD_VARIABLES, str(threads_per_step(self._settings))),
            **dict.fromkeys(SINGLE_THREAD_VARIABLES, "1"),
        }


def remove_left_scratch(settings: Settings) -> None:
    """Remove scratch directories of computations whose owner died without removing them.

    The data directory may be shared with other machines or containers, whose process ids mean nothing here: their
    directories are removed when no computation can last so long.
    """
    longest_s = 2.0 * settings.step_timeout_s
    for directory in (settings.data_dir.resolve() / "scratch").glob("run-*"):
        _, mark, owner, _ = directory.name.split("-")
        left = not psutil.pid_exists(int(owner)) if mark == _host_mark() else False
        with contextlib.suppress(FileNotFoundError):
            if left or time.time() - directory.stat().st_mtime > longest_s:
                shutil.rmtree(directory, ignore_errors=True)


def _host_mark() -> str:
    return hashlib.sha256(this_host().encode()).hexdigest()[:8]


async def _send(process: asyncio.subprocess.Process, request: Json) -> None:
    if process.stdin is None:  # pragma: no cover - a pipe was asked for
        return
    # a child that dies early is reported by its exit code, not by the broken pipe
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        process.stdin.write(json.dumps(request).encode() + b"\n")
        await process.stdin.drain()
    process.stdin.close()


async def _listen(reports: int, heard: _Conversation, on_progress: Callable[[float, str], None]) -> None:
    """Read the child's report pipe to its end."""
    reader = asyncio.StreamReader(limit=LINE_BYTES)
    transport, _ = await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(reports, "rb", buffering=0)
    )
    try:
        async for line in reader:
            if not line.endswith(b"\n"):
                break  # the child was killed while writing
            report = json.loads(line)
            if "result" in report:
                heard.result = report["result"]
            elif "problem" in report:
                heard.problem = report["problem"]
            else:
                heard.doing = report["message"]
                on_progress(report["fraction"], report["message"])
    finally:
        transport.close()


async def _overhear(process: asyncio.subprocess.Process, heard: _Conversation, step: str) -> None:
    """Pass what the child prints on to the log, and remember its last words."""
    if process.stdout is None:  # pragma: no cover - a pipe was asked for
        return
    async for line in process.stdout:
        text = line.decode(errors="replace").rstrip()
        heard.words.append(text[:500])
        log.info("said by the computing process", step=step, pid=process.pid, text=text)


def _ignore(_fraction: float, _message: str) -> None:
    """Take no notice of progress."""


def _ending(code: int) -> str:
    if code >= 0:
        return f"the computing process ended with code {code} and no result"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
    hint = {"SIGKILL": " (perhaps out of memory)", "SIGXCPU": " (limit of computing time)"}.get(name, "")
    return f"the computing process was ended by {name}{hint}"
