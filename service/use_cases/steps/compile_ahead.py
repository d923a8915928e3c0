"""Compile kernels in several processes at once, before practice comes to them one after the other.

It is known with which types practice calls them: `kernel_signatures.json` lists that, and

    uv run --no-sync python -m service.use_cases.steps.compile_ahead

writes it anew in a minute or two. What the list lacks practice compiles, so that it decides about time only.
"""

import importlib
import json
import os
import struct
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

LISTED = Path(__file__).with_name("kernel_signatures.json")
MOST_PROCESSES = 4
NUMBER = struct.Struct("=H")
Listed = tuple[str, str, Sequence[str]]
"""Module and name of a kernel, and the types of its arguments as numba writes them."""


def compile_ahead() -> None:
    """Compile what is listed with as many processes as there are cores; nothing happens where copies are not safe."""
    helpers = min(MOST_PROCESSES, len(os.sched_getaffinity(0)) if sys.platform == "linux" else 1) - 1
    if helpers < 1 or not is_alone():
        return
    listed = _listed()
    # a pipe is a queue from which several processes may take
    waiting, entry = os.pipe()
    os.write(entry, b"".join(map(NUMBER.pack, range(len(listed)))))
    os.close(entry)
    processes = []
    for _ in range(helpers):
        process = os.fork()
        if process == 0:
            try:
                _compile_from(waiting, listed)
            finally:
                os._exit(0)
        processes.append(process)
    try:
        _compile_from(waiting, listed)
    finally:
        os.close(waiting)
        for process in processes:
            os.waitpid(process, 0)


def load_listed() -> None:
    """Load what is listed, or compile what is not there."""
    for each in _listed():
        compile_listed(*each)


def _listed() -> Sequence[Listed]:
    return cast("Sequence[Listed]", json.loads(LISTED.read_text()))


def is_alone() -> bool:
    """Tell whether this process has one thread: only then is a copy of it whole."""
    tasks = Path("/proc/self/task")
    return not tasks.exists() or len(list(tasks.iterdir())) == 1


def called_with() -> Iterator[Listed]:
    """Give the kernels that were called or loaded in this process, and with which types."""
    from numba.core.dispatcher import Dispatcher

    for name, module in sorted(sys.modules.items()):
        if name.endswith("_kernels"):
            for word, value in vars(module).items():
                if isinstance(value, Dispatcher) and value.__module__ == name:
                    yield from (
                        (name, word, [repr(each) for each in types]) for types in value.signatures if _told(types)
                    )


def _told(types: Sequence[Any]) -> bool:
    """Tell whether types are what numba writes of them; those of constants, which kernels give each other, are not."""
    return all("Literal" not in repr(each) and _type_of(repr(each)) == each for each in types)


def _type_of(text: str) -> Any:
    import numba.core.types

    return eval(text, vars(numba.core.types))  # noqa: S307 - of our own file


def _compile_from(waiting: int, listed: Sequence[Listed]) -> None:
    """Compile what no other process has taken, until nothing is left."""
    while taken := os.read(waiting, NUMBER.size):
        compile_listed(*listed[NUMBER.unpack(taken)[0]])


def compile_listed(module: str, name: str, types: Sequence[str]) -> None:
    """Compile a kernel for arguments of given types; one that is no more, or takes others by now, is left out."""
    from numba.core.errors import NumbaError

    kernel: Any = getattr(importlib.import_module(module), name, None)
    if kernel is not None:
        with suppress(NumbaError, TypeError):  # the latter: another number of arguments
            kernel.compile(tuple(map(_type_of, types)))


def _write() -> None:
    """Practise where nothing is compiled, and list what was compiled: what others call comes long before them."""
    from numba.core import event

    from service.use_cases.steps.practice import practise

    heights: dict[str, int] = {}
    under_way: list[str] = []

    class Watch(event.Listener):
        def on_start(self, event: Any) -> None:
            under_way.append(_name(event))

        def on_end(self, event: Any) -> None:
            name, height = _name(event), heights.get(_name(event), 0)
            heights[name] = height
            under_way.pop()
            for caller in under_way[-1:]:
                heights[caller] = max(heights.get(caller, 0), height + 1)

    with event.install_listener("numba:compile", Watch()):
        practise()
    listed = sorted(called_with(), key=lambda each: heights.get(f"{each[0]}.{each[1]}", 0))
    LISTED.write_text("[\n" + ",\n".join(map(json.dumps, listed)) + "\n]\n")


def _name(event: Any) -> str:
    function = event.data["dispatcher"].py_func
    return f"{function.__module__}.{function.__qualname__}"


if __name__ == "__main__":
    if "NUMBA_CACHE_DIR" not in os.environ:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-P", "-m", "service.use_cases.steps.compile_ahead"]
            os.spawnve(os.P_WAIT, sys.executable, command, {**os.environ, "NUMBA_CACHE_DIR": folder})  # noqa: S606
    else:
        _write()
