"""Places for inspections, and for large requests: so many at the same time on one machine, and so many of one project.

Places are locks of Linux on single bytes of a file in the data directory: all processes of a machine share them, and
those of a process that dies are free at once. Within a process those who wait are let in in their order, and a large
file, for which several places are collected, holds up those behind it.
"""

import asyncio
import fcntl
import hashlib
import os
import struct
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import cache
from pathlib import Path
from weakref import WeakKeyDictionary

from service.refusals import BusyError
from service.settings import Settings
from service.use_cases.access.service_proof import LOCK
from service.use_cases.limits.machine_shares import machine_shares

GATE = 0
"""Byte that is locked by who collects places; the places are those that follow it."""
GATE_OF_REQUESTS = 1 << 60
"""The same for requests."""
ROOM_OF_PROJECT = 1 << 16
POLLING_S = 0.05
ASK_AGAIN_S = 10
_queues: "WeakKeyDictionary[asyncio.AbstractEventLoop, dict[tuple[Path, int], asyncio.Lock]]" = WeakKeyDictionary()


@asynccontextmanager
async def inspection_place(
    settings: Settings, owner: str, filename: str, size: int, wait_s: float | None = None
) -> AsyncIterator[None]:
    """Wait until a file may be inspected, and keep others waiting meanwhile.

    Parameters
    ----------
    settings
        Where the places are, how many, and how long is waited for one.
    owner
        Project of the file.
    filename
        For messages.
    size
        Of the file; a large one takes several places, and the memory of all of them.
    wait_s
        In place of what the settings say.

    Raises
    ------
    BusyError
        No place became free in time.
    """
    shares = machine_shares(settings)
    gates = (
        (_gate_of_project(owner), shares.places_of_project, 1),
        (GATE, shares.places, shares.places_for(size)),
    )
    wait_s = settings.inspect_wait_s if wait_s is None else wait_s
    async with _places(settings, gates, f"the inspection of '{filename}'", wait_s):
        yield


@asynccontextmanager
async def request_place(settings: Settings, owner: str) -> AsyncIterator[None]:
    """Wait until a large request may be read: one of a project at a time, and as many as there are processors.

    Raises
    ------
    BusyError
        No place became free in time.
    """
    gates = (
        (GATE_OF_REQUESTS + _gate_of_project(owner), 1, 1),
        (GATE_OF_REQUESTS, os.cpu_count() or 1, 1),
    )
    async with _places(settings, gates, "the reading of a large request", settings.inspect_wait_s):
        yield


def _gate_of_project(owner: str) -> int:
    return (1 + int.from_bytes(hashlib.sha256(owner.encode()).digest()[:5], "big")) * ROOM_OF_PROJECT


@asynccontextmanager
async def _places(
    settings: Settings, gates: Sequence[tuple[int, int, int]], what: str, wait_s: float
) -> AsyncIterator[None]:
    """Hold places behind gates: of each its byte, how many places there are, and how many are wanted."""
    deadline = time.monotonic() + wait_s
    path = settings.data_dir.resolve() / LOCK
    if not path.exists():
        path = _of_this_process(path)
    async with AsyncExitStack() as held:
        try:
            for gate, there, wanted in gates:
                for descriptor in await _taken(path, gate, there, wanted, deadline):
                    held.callback(os.close, descriptor)
        except TimeoutError:
            raise BusyError(what, wait_s, ASK_AGAIN_S) from None
        yield


async def _taken(path: Path, gate: int, there: int, wanted: int, deadline: float) -> Sequence[int]:
    """Give the locks of so many places, one after the other as they become free. TimeoutError when they do not."""
    held: list[int] = []
    try:
        async with asyncio.timeout(max(0.0, deadline - time.monotonic())), _turn(path, gate):
            # whoever collects several places is the only one who does
            held.append(await _first_free(path, [gate]))
            while len(held) <= wanted:
                held.append(await _first_free(path, range(gate + 1, gate + 1 + there)))
    except BaseException:
        for descriptor in held:
            os.close(descriptor)
        raise
    os.close(held.pop(0))
    return held


async def _first_free(path: Path, places: Sequence[int]) -> int:
    """Lock one of some bytes of a file as soon as one is free."""
    while True:
        for place in places:
            descriptor = _locked(path, place)
            if descriptor is not None:
                return descriptor
        await asyncio.sleep(POLLING_S)


@cache
def _of_this_process(path: Path) -> Path:
    """Give a file in memory in place of one that is not there, because no service runs on these data."""
    return Path(f"/proc/self/fd/{os.memfd_create(path.name)}")


@asynccontextmanager
async def _turn(path: Path, gate: int) -> AsyncIterator[None]:
    """Wait for one's turn within this process."""
    queues = _queues.setdefault(asyncio.get_running_loop(), {})
    async with queues.setdefault((path, gate), asyncio.Lock()):
        yield


def _locked(path: Path, place: int) -> int | None:
    """Lock a byte of a file; None while another one has it."""
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        # held by what was opened and not by the process, so that two requests to one process exclude each other
        fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, place, 1, 0))
    except OSError:
        os.close(descriptor)
        return None
    return descriptor
