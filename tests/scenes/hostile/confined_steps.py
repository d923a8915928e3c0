"""What a computation that a hostile file has taken over would try, as steps of the service."""

import ctypes
import errno
import fcntl
import os
import platform
import resource
import socket
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from service.ports import StepContext
from service.settings import Settings

SECRETS = ("TIELINE_DATABASE_URL", "TIELINE_CALLBACK_SECRET", "AWS_SECRET_ACCESS_KEY", "PGPASSWORD", "SOME_TOKEN")
HERE = Path(__file__).parent


def _outcome(attempt: Callable[[], object]) -> str:
    try:
        return f"done: {attempt()}"
    except OSError as error:
        return errno.errorcode[error.errno or 0]


def _call(x86_64: int, aarch64: int, *arguments: Any) -> int:
    """Make a system call by its number."""
    library = ctypes.CDLL(None, use_errno=True)
    code = library.syscall(x86_64 if platform.machine() == "x86_64" else aarch64, *arguments)
    if code < 0:
        raise OSError(ctypes.get_errno(), "refused")
    return int(code)


def try_all(context: StepContext, arguments: dict[str, Any]) -> dict[str, Any]:
    """Try; give what came of it by name."""
    path = context.blobs.local_path(arguments["key"])
    others: Mapping[str, str] = arguments["others"]
    attempts: dict[str, Callable[[], object]] = {
        "read the file": path.read_bytes,
        "list its folder": lambda: os.listdir(path.parent),  # noqa: PTH208
        "write the file": lambda: path.write_bytes(b"changed"),
        "remove the file": path.unlink,
        "give it another name": lambda: (context.blobs.scratch() / "link").hardlink_to(path),
        "open a socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM).close(),
        "start a program": lambda: subprocess.run(["/bin/true"], check=True),
        "leave its session": os.setsid,
        "leave its group": lambda: os.setpgid(0, 0),
        "signal its parent": lambda: os.kill(os.getppid(), 0),
        "read its parent": lambda: Path(f"/proc/{os.getppid()}/environ").read_bytes(),
        "change the rights of a file": lambda: path.chmod(0o777),
        "change the times of a file": lambda: os.utime(path),
        "give a file an attribute": lambda: os.setxattr(path, "user.a", b"1"),
        "limit its parent": lambda: resource.prlimit(os.getppid(), resource.RLIMIT_CPU),
        "hurry its parent": lambda: os.setpriority(os.PRIO_PROCESS, os.getppid(), 1),
        "move its parent": lambda: os.sched_setaffinity(os.getppid(), {0}),
        "schedule its parent": lambda: os.sched_setscheduler(os.getppid(), os.SCHED_OTHER, os.sched_param(0)),
        "schedule itself": lambda: os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0)),
        "make a process": os.fork,
        "be told of files by another": lambda: fcntl.fcntl(0, fcntl.F_SETOWN, os.getppid()),
        "become another user": lambda: os.setresuid(0, 0, 0),
        "name the machine": lambda: _call(170, 161, b"tieline", 7),
        "signal a thread of its parent": lambda: _call(234, 131, os.getppid(), os.getppid(), 0),
        "signal any thread": lambda: _call(200, 130, os.getppid(), 0),
        "signal by a descriptor": lambda: _call(424, 424, 0, 0, 0, 0),
        "share memory": lambda: _call(29, 194, 0, 4096, 0o1600),
        "share semaphores": lambda: _call(64, 190, 0, 1, 0o1600),
        "share messages": lambda: _call(68, 186, 0, 0o1600),
        "have users of its own": lambda: _call(56, 220, 0x10000000 | 17, 0, 0, 0, 0),
        "leave its namespaces": lambda: _call(272, 97, 0x10000000),
        "trace itself": lambda: _call(101, 117, 0, 0, 0, 0),
        "use another way of calls": lambda: _call(425, 425, 1, 0),
        "write a file of the system": lambda: Path("/tmp/tieline-was-here").write_bytes(b""),  # noqa: S108
        "write among the programs": lambda: (HERE / "tieline-was-here").write_bytes(b""),
        **{f"read {name}": lambda place=place: Path(place).read_bytes() for name, place in others.items()},  # type: ignore[misc]
    }
    found = {name: _outcome(attempt) for name, attempt in attempts.items()}
    scratch = context.blobs.scratch()
    (scratch / "made").write_bytes(b"1")
    known = Settings()
    return {
        "found": found,
        "scratch": (scratch / "made").read_bytes().decode(),
        "environment": {name: os.environ[name] for name in SECRETS if name in os.environ},
        "started with": Path("/proc/self/environ").read_bytes().decode("utf-8", "replace").split("\0"),
        "settings": [known.database_url, known.callback_secret, known.storage_url],
        "users": [os.getuid(), os.geteuid()],
        "threads": resource.getrlimit(resource.RLIMIT_NPROC)[0],
        "capabilities": Path("/proc/self/status").read_text().split("CapEff:")[1].split()[0],
        "privileges": ctypes.CDLL(None).prctl(39, 0, 0, 0, 0),
        "goes first": Path("/proc/self/oom_score_adj").read_text().strip(),
    }


def make(context: StepContext, arguments: dict[str, Any]) -> dict[str, Any]:
    """Make a blob under any key, or under one of its own something that is none."""
    made = context.blobs.scratch().parent / "blobs" / arguments["as"]
    made.parent.mkdir(parents=True, exist_ok=True)
    if arguments["kind"] == "blob":
        context.blobs.write_bytes(arguments["as"], b"made")
    elif arguments["kind"] == "link":
        made.symlink_to(arguments["to"])
    else:
        os.mkfifo(made)
    return {}


def fetch(_context: StepContext, arguments: dict[str, Any]) -> dict[str, Any]:
    """Try what one that fetches a file may, and may not."""
    place = arguments["href"]
    return {
        "found": {
            "reach a server": _outcome(lambda: socket.create_connection(("127.0.0.1", arguments["max_bytes"])).close()),
            "look a name up": _outcome(lambda: bool(socket.getaddrinfo("localhost", 80))),
            "read a file of the service": _outcome(lambda: Path(place).read_bytes()),
            "write a file of the service": _outcome(lambda: Path(place).write_bytes(b"changed")),
            "start a program": _outcome(lambda: subprocess.run(["/bin/true"], check=True)),
        },
        "environment": {name: os.environ[name] for name in SECRETS if name in os.environ},
    }


def stay(context: StepContext, arguments: dict[str, Any]) -> dict[str, Any]:
    """Leave a process behind."""
    if os.fork() == 0:
        time.sleep(60.0)
        os._exit(0)
    context.blobs.write_bytes(f"jobs/{arguments['job_id']}/result.json", str(os.getpid()).encode())
    return {}


STEPS = {"inspect-file": try_all, "echo": try_all, "make": make, "fetch-file": fetch, "stay": stay}
