"""What a reader that a hostile file has taken over would try, as a step of the service."""

import ctypes
import os
import socket
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from service.ports import StepContext

SECRETS = ("TIELINE_DATABASE_URL", "TIELINE_CALLBACK_SECRET", "AWS_SECRET_ACCESS_KEY", "PGPASSWORD", "SOME_TOKEN")


def _outcome(attempt: Callable[[], object]) -> str:
    try:
        return f"done: {attempt()}"
    except OSError as error:
        return type(error).__name__


def try_all(context: StepContext, arguments: dict[str, Any]) -> dict[str, Any]:
    """Try; give what came of it by name."""
    path = context.blobs.local_path(arguments["key"])
    others: Mapping[str, str] = arguments["others"]
    attempts: dict[str, Callable[[], object]] = {
        "read the file": path.read_bytes,
        "list its folder": lambda: os.listdir(path.parent),  # noqa: PTH208
        "write the file": lambda: path.write_bytes(b"changed"),
        "remove the file": path.unlink,
        "open a socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM).close(),
        "start a program": lambda: subprocess.run(["/bin/true"], check=True),
        "signal its parent": lambda: os.kill(os.getppid(), 0),
        "read its parent": lambda: Path(f"/proc/{os.getppid()}/environ").read_bytes(),
        "write a file of the system": lambda: Path("/tmp/tieline-was-here").write_bytes(b""),  # noqa: S108
        **{f"read {name}": lambda place=place: Path(place).read_bytes() for name, place in others.items()},  # type: ignore[misc]
    }
    found = {name: _outcome(attempt) for name, attempt in attempts.items()}
    scratch = context.blobs.scratch()
    (scratch / "made").write_bytes(b"1")
    return {
        "found": found,
        "scratch": (scratch / "made").read_bytes().decode(),
        "environment": {name: os.environ[name] for name in SECRETS if name in os.environ},
        "started with": Path("/proc/self/environ").read_bytes().decode("utf-8", "replace").split("\0"),
        "privileges": ctypes.CDLL(None).prctl(39, 0, 0, 0, 0),
        "goes first": Path("/proc/self/oom_score_adj").read_text().strip(),
    }


STEPS = {"inspect-file": try_all, "features": try_all}
