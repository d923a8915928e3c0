"""Threads of their own for what is written and hashed of uploads: nothing that is answered at once waits for them."""

import asyncio
import contextvars
import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

THREADS = 2
"""Hashing keeps a core busy each, and others wait for the disk; what is not written yet is not read from its client.
Where every thread has a priority of its own, the event loop goes before them."""
_niceness = [0]


def step_back(niceness: int) -> None:
    """Say how far these threads step back behind all else; before the first of them begins."""
    _niceness[0] = niceness


def _step_back() -> None:
    if sys.platform == "linux":
        # 0 is the thread that asks
        os.setpriority(os.PRIO_PROCESS, 0, max(_niceness[0], os.getpriority(os.PRIO_PROCESS, 0)))


_threads = ThreadPoolExecutor(THREADS, "upload", _step_back)
Value = TypeVar("Value")


async def undisturbed(function: Callable[..., Value], *arguments: Any) -> Value:
    """Run in a thread and wait for its end even when cancelled: a file must not be closed while it is written."""
    call = partial(contextvars.copy_context().run, function, *arguments)
    task = asyncio.ensure_future(asyncio.get_running_loop().run_in_executor(_threads, call))
    try:
        return await asyncio.shield(task)
    except asyncio.CancelledError:
        await asyncio.wait({task})
        raise
