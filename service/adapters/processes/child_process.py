"""Run one step in a process of its own: a copy of a nursery, or where there is none a fresh `service.child`."""

import asyncio
import contextlib
import hashlib
import json
import os
import secrets
import shutil
import signal
import sys
import tempfile
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, BinaryIO

import psutil
import structlog

from service.adapters.processes.handing import hand_out, made_bytes, pinned, take_in
from service.adapters.processes.nursery_client import NotWarmError, NurseryClient, WarmProcess, WarmUp
from service.adapters.processes.process_limits import DEFAULT_STEPS, is_harmless, this_host
from service.errors import ComputationFailedError, ServiceError, to_problem
from service.ports import REQUEST_BODY, REQUEST_INPUTS, BlobStore, Json, StepFailedError
from service.settings import Settings
from service.use_cases.steps.step_needs import FETCH, StepNeeds, needs_of

NOTHING_WARM = WarmUp()
LAST_WORDS_LINES = 12
LINE_BYTES = 1 << 26
THREAD_VARIABLES = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "RAYON_NUM_THREADS")
"""Loops over points, and chunks of LAZ files (lazrs): as many threads as the step may use."""
LIBRARY_VARIABLES = {
    **dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"),
    "MALLOC_MMAP_THRESHOLD_": str(64 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(512 << 20),
}
"""Matrices of some hundred rows: a second thread gains nothing on an idle machine and costs a factor on a busy one.
And the C library keeps arrays of a few megabytes that were freed: giving them back and fetching them anew takes a fifth
of the search of all shifts. The peak of memory is the same."""
log = structlog.get_logger()


@dataclass
class _Conversation:
    """What a child has said so far."""

    result: Json | None = None
    problem: Json | None = None
    wanted: bool = False
    words: deque[str] = field(default_factory=lambda: deque(maxlen=LAST_WORDS_LINES))
    doing: str = ""

    def last_words(self) -> str:
        """Give what it was doing and the end of what it printed."""
        said = "; ".join(line for line in self.words if line.strip())
        return ", ".join(
            part for part in (self.doing and f"while {self.doing}", said and f"last words: {said}") if part
        )

    def outcome(self, code: int) -> Json:
        """Return the result of a child that has ended with a code, or raise what went wrong."""
        if self.problem is not None:
            raise StepFailedError(self.problem)
        if self.result is None:
            raise ComputationFailedError(", ".join(filter(None, (_ending(code), self.last_words()))))
        return self.result


class ChildProcesses:
    """Run steps in child processes.

    Parameters
    ----------
    settings
        Limits, number of threads and place of the data; handed to the child.
    store
        Gives the store of blobs; copies of what is elsewhere are kept in a directory as long as it is there.
    steps
        ``module:attribute`` of the mapping of step names to functions.
    warm_up
        What they find loaded.
    """

    def __init__(
        self,
        settings: Settings,
        store: Callable[[Settings, Path], BlobStore],
        steps: str = DEFAULT_STEPS,
        warm_up: WarmUp = NOTHING_WARM,
    ) -> None:
        self._settings, self._store = settings, store
        self._steps = steps
        self._nursery = NurseryClient(steps, warm_up, partial(environment, settings), settings.niceness)
        self._scratch = settings.data_dir.resolve() / "scratch"
        self._scratch.mkdir(parents=True, exist_ok=True)

    def warm_up(self) -> None:
        """Load libraries already now."""
        if self._settings.nursery:
            self._nursery.start()

    def close(self) -> None:
        """End what is kept for computations to come, and computations."""
        self._nursery.close()

    async def run(
        self, step: str, arguments: Json, *, timeout_s: float, on_progress: Callable[[float, str], None] | None = None
    ) -> Json:
        """Give the step's output; see `service.ports.StepRunner`."""
        needs = needs_of(step, arguments)
        request = self._request(step, arguments)
        # in an object store, what is seldom needed is fetched when it is needed, and the step begun again
        for seldom in (False, True) if self._settings.storage_url.startswith("s3:") else (True,):
            heard = _Conversation()
            async with self._directory(timeout_s) as directory:
                code = await self._run(request, needs, heard, directory, seldom, on_progress or _ignore)
            if not heard.wanted:
                break
        return heard.outcome(code)

    async def read(self, step: str, arguments: Json, body: BinaryIO, *, timeout_s: float) -> tuple[Json, bytes]:
        """Return the step's output and what it made of a body; see `service.ports.RequestReader`."""
        heard = _Conversation()
        async with self._directory(timeout_s) as directory:
            own, copy = directory / "own", directory / "body"
            own.mkdir()
            await asyncio.to_thread(_copy, body, copy)
            handed = {"paths": {REQUEST_BODY: str(copy)}, "on_request": [], "scratch": str(own)}
            code = await self._converse({**self._request(step, arguments), **handed}, heard, _ignore)
            output = heard.outcome(code)
            made = await asyncio.to_thread(made_bytes, own, REQUEST_INPUTS)
        return output, made

    def _request(self, step: str, arguments: Json) -> Json:
        settings = self._settings.model_dump(mode="json", exclude=_unneeded_by(step))
        return {"step": step, "arguments": arguments, "settings": settings}

    @asynccontextmanager
    async def _directory(self, timeout_s: float) -> AsyncIterator[Path]:
        """Yield a directory for one run, which must end in time."""
        directory = self._scratch / f"run-{_host_mark()}-{os.getpid()}-{secrets.token_hex(6)}"
        directory.mkdir()
        try:
            async with asyncio.timeout(timeout_s):
                yield directory
        except TimeoutError:
            error = ComputationFailedError(f"the computation took longer than {timeout_s:g} s and was stopped")
            raise StepFailedError(to_problem(error)) from None
        finally:
            shutil.rmtree(directory, ignore_errors=True)

    async def _run(
        self,
        request: Json,
        needs: StepNeeds,
        heard: _Conversation,
        directory: Path,
        seldom: bool,
        on_progress: Callable[[float, str], None],
    ) -> int:
        """Hand the child what it needs, listen to it, and take in what it made."""
        own = directory / "own"  # beside copies that others read as well, to which it must not write
        own.mkdir()
        blobs = self._store(self._settings, directory)
        try:
            handed = await asyncio.to_thread(hand_out, needs, blobs, seldom=seldom)
            handed["paths"] = await asyncio.to_thread(pinned, handed["paths"], directory)
            code = await self._converse({**request, **handed, "scratch": str(own)}, heard, on_progress)
            if heard.result is not None:
                await asyncio.to_thread(take_in, needs, own, blobs)
        except ComputationFailedError:
            raise
        except (ServiceError, OSError) as error:
            raise StepFailedError(to_problem(error)) from error
        return code

    async def _converse(self, request: Json, heard: _Conversation, on_progress: Callable[[float, str], None]) -> int:
        """Start the child, listen until it ends; kill it and all it started whatever happens."""
        try:
            return await self._attempt(request, heard, on_progress)
        except NotWarmError:
            return await self._attempt(request, heard, on_progress)

    async def _attempt(self, request: Json, heard: _Conversation, on_progress: Callable[[float, str], None]) -> int:
        reports, reports_end = os.pipe()
        output, output_end = os.pipe()
        try:
            with tempfile.TemporaryFile(dir=self._scratch) as file:
                file.write(json.dumps(request).encode() + b"\n")
                file.seek(0)
                process = await self._started(str(request["step"]), file, reports_end, output_end)
        except BaseException:
            os.close(reports)
            os.close(output)
            raise
        finally:
            os.close(reports_end)
            os.close(output_end)
        listeners = [
            asyncio.ensure_future(_listen(reports, heard, on_progress)),
            asyncio.ensure_future(_overhear(output, heard, str(request["step"]))),
        ]
        try:
            return await process.wait()
        finally:
            process.kill()
            await asyncio.shield(asyncio.gather(process.wait(), *listeners, return_exceptions=True))

    async def _started(self, step: str, request: IO[bytes], reports: int, output: int) -> "_ColdProcess | WarmProcess":
        # what fetches gets credentials, which no copy of the nursery has
        if self._settings.nursery and self._nursery.usable and step != FETCH:
            return self._nursery.begin(step, request, reports, output)
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", "service.child"),
            *("--steps", self._steps, "--parent", str(os.getpid()), "--report-fd", str(reports)),
            stdin=request,
            stdout=output,
            stderr=output,
            start_new_session=True,
            pass_fds=(reports,),
            env={**environment(self._settings), **(_credentials() if step == FETCH else {})},
        )
        return _ColdProcess(process)


@dataclass(frozen=True)
class _ColdProcess:
    """A child that loads its libraries itself."""

    process: asyncio.subprocess.Process

    async def wait(self) -> int:
        """Give the exit code, negative for a signal."""
        return await self.process.wait()

    def kill(self) -> None:
        """End it and all that it started."""
        # the group has the child's number, so grandchildren that hold a pipe open end too
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)


def _unneeded_by(step: str) -> set[str]:
    """Name the settings that a step must not know, or that only hold beside these: it is handed what it needs."""
    of_many = {"database_url", "workers", "queue"}
    return of_many | {"callback_secret", "storage_url", *(() if step == FETCH else ("allowed_sources",))}


def _credentials() -> Mapping[str, str]:
    """Give the variables by which object stores are reached, and certificates found."""
    return {name: value for name, value in os.environ.items() if name.startswith(("AWS_", "SSL_CERT_"))}


def environment(settings: Settings) -> Mapping[str, str]:
    """Give the variables of a computing process: none with secrets, and what libraries must know from their start."""
    return {
        **{name: value for name, value in os.environ.items() if is_harmless(name)},
        **dict.fromkeys(THREAD_VARIABLES, str(settings.threads_per_computation)),
        **LIBRARY_VARIABLES,
        "TIELINE_NICENESS": str(settings.niceness),
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


async def _listen(reports: int, heard: _Conversation, on_progress: Callable[[float, str], None]) -> None:
    """Read the child's report pipe to its end."""
    async for line in _lines(reports):
        if not line.endswith(b"\n"):
            break  # the child was killed while writing
        report = json.loads(line)
        if "result" in report:
            heard.result = report["result"]
        elif "problem" in report:
            heard.problem = report["problem"]
        elif "wanted" in report:
            heard.wanted = True
        else:
            heard.doing = report["message"]
            on_progress(report["fraction"], report["message"])


async def _overhear(output: int, heard: _Conversation, step: str) -> None:
    """Pass what the child prints on to the log, and remember its last words."""
    async for line in _lines(output):
        text = line.decode(errors="replace").rstrip()
        heard.words.append(text[:500])
        log.info("said by the computing process", step=step, text=text)


async def _lines(pipe: int) -> AsyncIterator[bytes]:
    """Read a pipe to its end, and close it."""
    reader = asyncio.StreamReader(limit=LINE_BYTES)
    transport, _ = await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(pipe, "rb", buffering=0)
    )
    try:
        async for line in reader:
            yield line
    finally:
        transport.close()


def _copy(body: BinaryIO, path: Path) -> None:
    body.seek(0)
    with path.open("wb") as file:
        shutil.copyfileobj(body, file)


def _ignore(_fraction: float, _message: str) -> None:
    """Take no notice of progress."""


def _ending(code: int) -> str:
    if code >= 0:
        return f"the computing process ended with code {code} and no result"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
    hint = {"SIGKILL": " (perhaps out of memory)", "SIGXCPU": " (limit of computing time)"}.get(name, "")
    return f"the computing process was ended by {name}{hint}"
