"""A computation of a service that runs as root becomes a user of its own (Linux)."""

import ctypes
import os
import resource
import signal
import struct
import sys
from pathlib import Path

FIRST_USER = 2_000_000_000
"""Users from here on belong to computations, each to the one with that process id; no system names them."""
MOST_THREADS = 1024
"""Of one computation."""
SET_PARENT_DEATH_SIGNAL, SET_SECURE_BITS = 1, 28
KEEP_ON_CHANGE = 1 << 2
"""SECBIT_NO_SETUID_FIXUP: what is left at a change of the user is said, not implied."""
CAPABILITIES_VERSION = 0x20080522
CHOWN, OVERRIDE, SEARCH, KILL, SETGID, SETUID, SETPCAP = 0, 1, 2, 5, 6, 7, 8
NEEDED = sum(1 << each for each in (KILL, SETGID, SETUID, SETPCAP))


def become_own_user(data_dir: Path) -> bool:
    """Leave root for a user whom no other process has, without any privilege.

    It can then send signals to nobody, and its threads are counted apart from all others. Files are read and written as
    root does, but without root's privilege to pass over their rights: that is kept only where the data are another
    user's. What may be read at all is decided afterwards, by `confinement.confine`.

    Parameters
    ----------
    data_dir
        Where the data are.

    Returns
    -------
    Whether it did: not where the service does not run as root, or a container has taken the privileges to do so.
    """
    if sys.platform != "linux" or os.geteuid() != 0 or _effective() & NEEDED != NEEDED:
        return False
    parent, user = os.getppid(), FIRST_USER + os.getpid()
    library = ctypes.CDLL(None, use_errno=True)
    if library.prctl(SET_SECURE_BITS, KEEP_ON_CHANGE, 0, 0, 0) != 0:
        return False
    try:
        os.setgroups([])
        os.setresgid(user, user, user)
        os.setresuid(user, user, user)
    except OSError:  # the container knows no such user
        return False
    library.setfsuid(0)
    library.setfsgid(0)
    left = (1 << OVERRIDE | 1 << SEARCH) if data_dir.stat().st_uid != 0 else 0
    header = ctypes.create_string_buffer(struct.pack("Ii", CAPABILITIES_VERSION, 0))
    sets = ctypes.create_string_buffer(struct.pack("6I", left, left, 0, 0, 0, 0))
    if library.capset(header, sets) != 0:
        raise OSError(ctypes.get_errno(), "the privileges of root cannot be given up")
    # a change of the user takes back that this process ends with its parent
    library.prctl(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        raise SystemExit(1)
    return True


def limit_threads(*, is_alone: bool) -> None:
    """Limit how many threads there may be: of this computation, or else of all processes of its user.

    Parameters
    ----------
    is_alone
        Whether no other process has its user.
    """
    most = MOST_THREADS if is_alone else MOST_THREADS + _threads_of_user()
    _, hard = resource.getrlimit(resource.RLIMIT_NPROC)
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_NPROC, (most, most))


def _effective() -> int:
    """Return the capabilities that are in force, a bit each."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line.split()[1] for line in lines if line.startswith("CapEff:")), 16)


def _threads_of_user() -> int:
    """Count the threads of all processes of this user."""
    user, count = os.getuid(), 0
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if place.stat().st_uid == user:
                count += len(list((place / "task").iterdir()))
        except OSError:  # it has ended meanwhile, or is hidden
            continue
    return count
