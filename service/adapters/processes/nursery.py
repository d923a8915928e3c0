"""A process with the libraries loaded, of which each computation is a copy: `python -m service.child --channel`.

Loading the libraries takes seconds, copying a process milliseconds. It only forks, reaps and kills, so it has one
thread and little that could break. Each copy is a session of its own, limited, and ends after one step.
A worker sends orders over a socket: ``{"number", "step"}`` with three descriptors (request, reports, output) starts a
computation, ``{"kill": number}`` ends one with all that it started. Answers: ``{"ready"}`` once, ``{"number", "code"}``
when a computation has ended.

What only the last steps of a job need is loaded while the first ones run, and not before there are any. Compiled
kernels are loaded too, for a copy would load them anew each time; but where they are not compiled yet that takes
minutes, in which no order would be followed. So a copy, the scout, compiles them first, in an idle moment or after the
first pair of scans; then another one those that few computations need, which are loaded by these alone.

`multiprocessing`'s fork server starts copies quickly enough, and there would be less to read here. But it inherits the
worker's environment, whose secrets then stay in the memory of every copy; it reaps a copy at once, after which nobody
can end what the copy left running without the risk of ending a stranger that got its number; and it loads all before
the first copy, or never.
"""

import contextlib
import ctypes
import gc
import json
import os
import selectors
import signal
import socket
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from service.adapters.processes.process_limits import be_called, die_with_parent, let_others_first
from service.ports import Json
from service.use_cases.steps.compile_ahead import is_alone

MESSAGE_BYTES = 4096
DESCRIPTORS = 3
SHORT_PAUSE_S, LONG_PAUSE_S = 0.3, 2.0
SCOUT = "tieline-scout"
"""Name of the copy that practises first."""
PRACTISED_STEP = "register-pair"
"""When it has succeeded once, nearly all kernels are compiled."""
LAST_NICENESS = 10
"""Who compiles what few need steps back as far as this."""


@dataclass(frozen=True)
class _Computation:
    """What runs in a process."""

    number: int
    step: str


@dataclass(frozen=True)
class Kernels:
    """How compiled kernels come into a process; None: there is nothing to do."""

    practise: Callable[[], None] | None = None
    """Compiles those that most computations need, and loads them."""
    load: Callable[[], None] | None = None
    """Loads them, when that has succeeded."""
    compile_rest: Callable[[], None] | None = None
    """Compiles the others."""


class Nursery:
    """Starts, ends and reaps computations as a worker orders.

    Parameters
    ----------
    channel
        Socket to the worker that keeps messages apart (SOCK_SEQPACKET).
    compute
        Does what a request asks for, reports to a descriptor, and says whether it succeeded.
    later
        Loads what the first computations do not need; None: nothing to load.
    kernels
        Compiles and loads kernels.
    niceness
        How far a copy that compiles steps back.
    """

    def __init__(
        self,
        channel: socket.socket,
        compute: Callable[[Json, int], bool],
        later: Callable[[], None] | None = None,
        kernels: Kernels = Kernels(),
        niceness: int = 0,
    ) -> None:
        self._channel = channel
        self._compute = compute
        self._later = later
        self._load_kernels = kernels.load
        self._practices = [
            (practice, least)
            # the first does not step back more: the first job waits for it rather than compile as well
            for practice, least in ((kernels.practise, niceness), (kernels.compile_rest, max(niceness, LAST_NICENESS)))
            if practice is not None
        ]
        self._scout: int | None = None
        self._paired = self._may_load = False
        self._running: dict[int, _Computation] = {}
        self._woken, self._waking = os.pipe()
        for descriptor in (self._woken, self._waking):
            os.set_blocking(descriptor, False)

    def serve(self) -> None:
        """Work until the worker closes its end; then end what still runs."""
        if not is_alone():
            sys.exit("a library has started threads; computations start without copies")
        _freeze()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the worker decides when to stop
        signal.signal(signal.SIGCHLD, lambda *_: None)  # a handler is needed for the wake-up
        signal.set_wakeup_fd(self._waking)
        self._channel.send(b'{"ready": true}')
        with selectors.DefaultSelector() as selector:
            selector.register(self._channel, selectors.EVENT_READ)
            selector.register(self._woken, selectors.EVENT_READ)
            while True:
                ready = {key.fd for key, _ in selector.select(self._patience_s)}
                if not ready:
                    self._prepare()
                if self._woken in ready:
                    with contextlib.suppress(BlockingIOError):
                        os.read(self._woken, MESSAGE_BYTES)
                    self._reap()
                if self._channel.fileno() in ready and not self._obey():
                    break
        for process in [*self._running, *([] if self._scout is None else [self._scout])]:
            _end(process)

    def _obey(self) -> bool:
        """Follow one order; False when there will be no more."""
        try:
            message, descriptors, _, _ = socket.recv_fds(self._channel, MESSAGE_BYTES, DESCRIPTORS)
        except ConnectionResetError:
            return False
        if not message:
            return False
        order = json.loads(message)
        if "kill" in order:
            for process, computation in self._running.items():
                if computation.number == order["kill"]:
                    _end(process)
            return True
        parent = os.getpid()
        try:
            process = os.fork()
        except OSError:  # no memory or no process left at the moment: those that run are not to suffer from it
            self._tell(order["number"], os.EX_OSERR)
        else:
            if process == 0:
                self._be_a_computation(parent, descriptors)
            self._running[process] = _Computation(order["number"], order["step"])
        for descriptor in descriptors:
            os.close(descriptor)
        return True

    def _tell(self, number: int, code: int) -> None:
        """Tell the worker that a computation has ended."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._channel.send(json.dumps({"number": number, "code": code}).encode())

    def _be_a_computation(self, parent: int, descriptors: Sequence[int]) -> None:
        """Compute in this process, which never returns from here."""
        done = False
        try:
            self._leave(parent)
            request, reports, output = descriptors
            os.dup2(output, sys.stdout.fileno())
            os.dup2(output, sys.stderr.fileno())
            os.close(output)
            with os.fdopen(request, "rb") as file:
                document = json.load(file)
            done = self._compute(document, reports)
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            # nothing of the libraries is waited for, nor may the parent's loop go on here
            os._exit(0 if done else 1)

    def _leave(self, parent: int) -> None:
        """Make this copy a session of its own that ends with the nursery, and that has nothing of its work."""
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.setsid()
        die_with_parent(parent)
        self._channel.close()
        os.close(self._woken)
        os.close(self._waking)

    def _send_scout(self) -> None:
        """Let a copy practise what comes next: when it has succeeded, that is compiled, and loading it takes little."""
        practice, niceness = self._practices.pop(0)
        parent = os.getpid()
        try:
            self._scout = os.fork()
        except OSError:  # no memory or no process left: it can be done without
            self._give_up_practice()
            return
        if self._scout == 0:
            done = False
            try:
                self._leave(parent)
                be_called(SCOUT)
                let_others_first(niceness)
                practice()
                done = True
            finally:
                if not done:  # it can be done without; the worker's log shows why
                    traceback.print_exc()
                os._exit(0 if done else 1)

    def _reap(self) -> None:
        """Tell of computations that have ended, after ending what they left running."""
        while True:
            try:
                ended = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            except ChildProcessError:
                return
            if ended is None:
                return
            # the number of the group stays taken until its leader is reaped
            _end(ended.si_pid)
            _, status = os.waitpid(ended.si_pid, 0)
            computation = self._running.pop(ended.si_pid, None)
            if computation is not None:
                code = os.waitstatus_to_exitcode(status)
                self._paired |= code == 0 and computation.step == PRACTISED_STEP
                self._tell(computation.number, code)
            elif ended.si_pid == self._scout:
                self._scout = None
                self._may_load = True
                if status != 0:
                    self._give_up_practice()

    def _give_up_practice(self) -> None:
        self._practices, self._load_kernels = [], None

    @property
    def _patience_s(self) -> float | None:
        """How long to wait for an order before loading more; None: there is nothing to load now."""
        if (self._later is not None and self._running) or (self._load_kernels is not None and self._may_load):
            return SHORT_PAUSE_S
        if not self._practices or self._scout is not None:
            return None
        if self._paired:
            return SHORT_PAUSE_S
        return None if self._running else LONG_PAUSE_S

    def _prepare(self) -> None:
        """Load more, once, for all computations to come."""
        if self._later is not None and self._running:
            load, self._later = self._later, None
        elif self._load_kernels is not None and self._may_load:
            load, self._load_kernels = self._load_kernels, None
        else:
            if self._practices and self._scout is None:
                self._send_scout()
            return
        load()
        _freeze()


def _freeze() -> None:
    """Let later collections, in this process and its copies, touch (and so copy) nothing of what there is now, and give
    back what loading has left free, which `MALLOC_TRIM_THRESHOLD_` would keep.
    """
    gc.collect()
    gc.freeze()
    with contextlib.suppress(OSError, AttributeError):  # only the GNU library has it
        ctypes.CDLL(None).malloc_trim(0)


def _end(process: int) -> None:
    """Kill a computation that is not reaped yet, and all that it started."""
    try:
        os.killpg(process, signal.SIGKILL)
    except ProcessLookupError:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)  # it has not become a group of its own yet
