"""The worker's side of `service.adapters.processes.nursery`: it starts the nursery and orders computations."""

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import IO

import structlog

from service.errors import ComputationFailedError

MESSAGE_BYTES = 4096
log = structlog.get_logger()


class NotWarmError(Exception):
    """The nursery did not come up; computations start without it."""


@dataclass(frozen=True)
class WarmUp:
    """What computations find loaded; each ``module:function``, empty for nothing."""

    libraries: str = ""
    """Loads the libraries before the first computation."""
    later: str = ""
    """Loads libraries that the first computation does not need, while it runs."""
    practice: str = ""
    """Compiles kernels, in a copy of the process, in an idle moment."""
    kernels: str = ""
    """Loads them when that has succeeded."""
    rest: str = ""
    """Compiles those that few computations need, in another copy that lets everything else go first."""


class WarmProcess:
    """One computation."""

    def __init__(self, nursery: "NurseryClient", number: int, code: "Future[int]") -> None:
        self._nursery = nursery
        self._number = number
        self._code = code

    async def wait(self) -> int:
        """Give the exit code, negative for a signal.

        Raises
        ------
        NotWarmError
            The nursery ended before it served.
        ComputationFailedError
            The nursery died, and the computation with it.
        """
        return await asyncio.shield(asyncio.wrap_future(self._code))

    def kill(self) -> None:
        """End it and all that it started; nothing happens when it has ended."""
        if not self._code.done():
            self._nursery.kill(self._number)


class NurseryClient:
    """Starts computations in a nursery, which it starts and, when it has died, starts again.

    Parameters
    ----------
    steps
        ``module:attribute`` of the mapping of step names to functions.
    warm_up
        What to load.
    environment
        Gives all of it: among others what must be known before libraries are loaded.
    niceness
        How far it steps back while it compiles kernels.
    """

    def __init__(
        self, steps: str, warm_up: WarmUp, environment: Callable[[], Mapping[str, str]], niceness: int
    ) -> None:
        self._steps, self._warm_up, self._environment, self._niceness = steps, warm_up, environment, niceness
        self._lock = threading.Lock()
        self._channel: socket.socket | None = None
        self._waiting: dict[int, Future[int]] = {}
        self._number = 0
        self._usable = hasattr(socket, "SOCK_SEQPACKET") and sys.platform == "linux"
        self._stop: weakref.finalize[..., NurseryClient] | None = None

    @property
    def usable(self) -> bool:
        """Whether computations can be started here."""
        return self._usable

    def start(self) -> None:
        """Start the nursery if it does not run; the libraries are loaded while the caller goes on."""
        with self._lock:
            if self._usable and self._channel is None:
                self._start()

    def begin(self, step: str, request: IO[bytes], reports: int, output: int) -> WarmProcess:
        """Start a computation.

        Parameters
        ----------
        step
            Its name.
        request
            File with the JSON request, at its beginning.
        reports, output
            Descriptors to write reports and all other output to; the caller closes its own.
        """
        with self._lock:
            if self._channel is None:
                self._start()
            if self._channel is None:  # pragma: no cover - _start sets it
                raise NotWarmError
            self._number += 1
            number, code = self._number, Future[int]()
            self._waiting[number] = code
            message = json.dumps({"number": number, "step": step}).encode()
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the listener tells of its death
                socket.send_fds(self._channel, [message], [request.fileno(), reports, output])
        return WarmProcess(self, number, code)

    def kill(self, number: int) -> None:
        """Order the end of a computation."""
        with self._lock, contextlib.suppress(BrokenPipeError, ConnectionResetError):
            if self._channel is not None:
                self._channel.send(json.dumps({"kill": number}).encode())

    def close(self) -> None:
        """End the nursery and all its computations."""
        with self._lock:
            stop, self._channel = self._stop, None
        if stop is not None:
            stop()

    def _start(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            process = subprocess.Popen(  # noqa: S603 - our own module
                [
                    *(sys.executable, "-P", "-m", "service.child", "--steps", self._steps),
                    *("--warm-up", self._warm_up.libraries, "--later", self._warm_up.later),
                    *("--practice", self._warm_up.practice, "--kernels", self._warm_up.kernels),
                    *("--rest", self._warm_up.rest),
                    *("--niceness", str(self._niceness)),
                    *("--parent", str(os.getpid()), "--channel", str(theirs.fileno())),
                ],
                stdin=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
                env=dict(self._environment()),
            )
        self._channel = ours
        self._stop = weakref.finalize(self, _stop, process, ours)
        listener = threading.Thread(
            target=_listen, args=(weakref.ref(self), ours, process), name="nursery", daemon=True
        )
        listener.start()

    def hear(self, answer: "dict[str, int]") -> None:
        """Take note of the end of a computation."""
        with self._lock:
            code = self._waiting.pop(answer["number"], None)
        if code is not None:
            code.set_result(answer["code"])

    def lose(self, channel: socket.socket, *, served: bool, ending: int) -> None:
        """Take note of the end of the nursery."""
        with self._lock:
            if channel is self._channel:
                self._channel = None
                if not served:
                    self._usable = False
                    log.warning("computations start without a nursery", code=ending)
            waiting, self._waiting = self._waiting, {}
        for code in waiting.values():
            code.set_exception(
                ComputationFailedError(f"the process that starts computations ended with code {ending}")
                if served
                else NotWarmError()
            )


def _listen(client: "weakref.ref[NurseryClient]", channel: socket.socket, process: "subprocess.Popen[bytes]") -> None:
    """Pass the answers of a nursery on until it ends."""
    served = False
    while True:
        try:
            message = channel.recv(MESSAGE_BYTES)
        except OSError:
            message = b""
        if not message:
            break
        answer = json.loads(message)
        served = served or "ready" in answer
        owner = client()
        if owner is not None and "number" in answer:
            owner.hear(answer)
        del owner
    process.wait()
    owner = client()
    if owner is not None:
        owner.lose(channel, served=served, ending=process.returncode)
    channel.close()


def _stop(process: "subprocess.Popen[bytes]", channel: socket.socket) -> None:
    """End a nursery: its computations die with it."""
    process.kill()
    with contextlib.suppress(OSError):
        channel.shutdown(socket.SHUT_RDWR)
    process.wait()
