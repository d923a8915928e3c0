"""Where a process of the service runs, and its limits. Imports little: every computation starts with it."""

import contextlib
import ctypes
import os
import resource
import signal
import socket
import sys
from pathlib import Path
from typing import Any

from service.settings import Settings

DEFAULT_STEPS = "service.processes:STEPS"

HARMLESS: tuple[str, ...] = (
    "PATH",
    "HOME",
    "LANG",
    "LC_",
    "TZ",
    "TMPDIR",
    "PYTHON",
    "VIRTUAL_ENV",
    "LD_",
    "NUMBA_",
    "OMP_",
    "OPENBLAS_",
)
HARMLESS += ("MKL_", "VECLIB_", "MALLOC_", "XDG_CACHE_HOME", "COLUMNS", "TERM")
"""Beginnings of the names of variables that hold no secrets and that a computation may need."""
FIRST_TO_GO = 900
"""Of 1000: what computes can be begun again, what answers or keeps data cannot."""


def is_harmless(name: str) -> bool:
    """Tell whether a variable of the environment holds no secret."""
    return name.startswith(HARMLESS)


def die_with_parent(parent: int) -> None:
    """Ask the kernel to kill this process when its parent ends, and end now if that has happened already."""
    if sys.platform == "linux":
        set_parent_death_signal = 1
        _prctl(set_parent_death_signal, signal.SIGKILL)
    if os.getppid() != parent:
        raise SystemExit(1)


def be_called(name: str) -> None:
    """Show this process under a name of its own, of up to 15 letters, among copies of the same program."""
    if sys.platform == "linux":
        set_name = 15
        _prctl(set_name, ctypes.create_string_buffer(name.encode()))


def _prctl(option: int, value: Any) -> None:
    ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def this_host() -> str:
    """Name this machine, boot and process namespace: only within it does a process id mean anything."""
    boot, namespace = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
    parts = [socket.gethostname()]
    if boot.exists():
        parts.append(boot.read_text().strip())
    if namespace.exists():
        parts.append(str(namespace.readlink()))
    return "/".join(parts)


def let_others_first(niceness: int) -> None:
    """Lower the priority of this process and all it starts: requests are answered at once while it computes.

    Linux shares processors among sessions before it looks at the processes in them, unless control groups divide them;
    then only the second counts. As a batch process it never takes a processor from one that answers when it wakes up.

    Parameters
    ----------
    niceness
        0 changes nothing.
    """
    if niceness == 0:
        return
    os.setpriority(os.PRIO_PROCESS, 0, max(niceness, os.getpriority(os.PRIO_PROCESS, 0)))
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    # refused where another process was given a priority within the last tenth of a second, and to some containers
    with contextlib.suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(niceness))


def go_first() -> None:
    """Let the kernel end this process before all others when the machine's memory is used up."""
    with contextlib.suppress(OSError):  # some containers do not let it be changed
        Path("/proc/self/oom_score_adj").write_text(str(FIRST_TO_GO))


def limit_resources(settings: Settings, memory_bytes: int | None = None) -> None:
    """Limit memory, computing time, file size and core dumps of this process.

    Memory is limited as data (`RLIMIT_DATA`: heap and private writable maps), not as address space: open3d and numba
    reserve tens of gigabytes of address space that they never touch.
    """
    used = _data_bytes()
    _limit(resource.RLIMIT_DATA, used + (memory_bytes or settings.step_memory_bytes))
    # the hard limit later, so that it ends by SIGXCPU, which says why, and not by SIGKILL
    _limit(resource.RLIMIT_CPU, settings.step_timeout_s * (settings.threads_per_computation + 1), grace=10)
    _limit(resource.RLIMIT_FSIZE, 4 * settings.max_file_bytes)
    _limit(resource.RLIMIT_CORE, 0)


def _limit(which: int, value: int, grace: int = 0) -> None:
    _, hard = resource.getrlimit(which)
    soft, later = (limit if hard == resource.RLIM_INFINITY else min(limit, hard) for limit in (value, value + grace))
    resource.setrlimit(which, (soft, later))


def _data_bytes() -> int:
    """Give the data size of this process at the moment, where the kernel tells it."""
    status = Path("/proc/self/status")
    if not status.exists():
        return 0
    lines = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
    return int(lines["VmData"].split()[0]) * 1024
