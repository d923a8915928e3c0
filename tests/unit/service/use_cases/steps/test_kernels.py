"""Kernels are compiled by one process, and the others know what they wait for."""

import importlib
import json
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.caching import Cache

from service.ports import Json
from service.use_cases.steps import kernels
from service.use_cases.steps.compile_ahead import LISTED
from service.use_cases.steps.kernels import (
    CLOUDS,
    COMPILING,
    EDGES_OF_PHOTOS,
    KERNELS,
    LINES_OF_PHOTOS,
    METHODS,
    NETWORKS,
    SCANS,
    TERRAIN,
    compile_once,
    counted_kernels,
    keep_kernels_as_they_are,
)
from service.use_cases.steps.step_preparation import parts_of

WITHIN_S = 60.0
NOT_CALLED = """
import importlib, json, pathlib, sys
from numba.core.dispatcher import Dispatcher
from service.use_cases.steps.compile_ahead import called_with
from service.use_cases.steps.kernels import KERNELS, PRACTICES, SCANS, import_kernels

import_kernels()
PRACTICES[SCANS]()
print(json.dumps(list(called_with())))
for part, practice in PRACTICES.items():
    if part != SCANS:
        practice()
modules = {name: module for name, module in sys.modules.items() if name.endswith("_kernels")}
named = {(name, word) for name, module in modules.items() for word, value in vars(module).items()
         if isinstance(value, Dispatcher) and value.__module__ == name and not value.signatures}
print(json.dumps(sorted(named)))
"""
"""Lists with which types kernels are called that all registrations need; then those that no practice called, and no
other kernel of which they are part was compiled in this process.
"""
WRITE = "run: uv run --no-sync python -m service.use_cases.steps.compile_ahead"
AHEAD = """
import os, sys
from pathlib import Path
from service.use_cases.steps import compile_ahead

sys.path.insert(0, sys.argv[1])
os.sched_getaffinity = lambda _: {0, 1, 2}
compile_ahead.LISTED = Path(sys.argv[1]) / "listed.json"
compile_ahead.compile_ahead()
try:
    os.waitpid(-1, os.WNOHANG)
except ChildProcessError:
    print("nobody is left")
"""


class Hearer:
    def __init__(self, enough: threading.Event | None = None) -> None:
        self.heard: list[str] = []
        self._enough = enough or threading.Event()

    def report(self, fraction: float, message: str) -> None:
        assert fraction == 0.0
        self.heard.append(message)
        self._enough.set()


@contextmanager
def counted_once(tell: Callable[[], None]) -> Iterator[None]:
    tell()
    yield


def test_of_several_that_need_them_one_compiles_and_the_others_tell_how_far_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernels, "LOOK_S", 0.01)
    compiled: list[int] = []
    heard = [threading.Event() for _ in range(3)]
    hearers = [Hearer(each) for each in heard]

    def compile_all() -> None:
        compiled.append(1)
        # not before all have been told
        assert all(each.wait(WITHIN_S) for each in heard)

    threads = [
        threading.Thread(target=compile_once, args=(tmp_path, compile_all, counted_once, hearer)) for hearer in hearers
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WITHIN_S)
    assert compiled == [1]
    assert all(words.startswith(f"{COMPILING}: ") for hearer in hearers for words in hearer.heard)


def test_all_that_compile_at_once_are_counted(tmp_path: Path) -> None:
    tellers, each = 4, 300
    failed: list[BaseException] = []
    told: list[Callable[[], None]] = []

    @contextmanager
    def counted(tell: Callable[[], None]) -> Iterator[None]:
        told.append(tell)
        yield

    def tell_often() -> None:
        try:
            for _ in range(each):
                told[0]()
        except BaseException as error:  # noqa: BLE001 - whatever it is
            failed.append(error)

    def compile_all() -> None:
        threads = [threading.Thread(target=tell_often) for _ in range(tellers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(WITHIN_S)

    hearer = Hearer()
    compile_once(tmp_path, compile_all, counted, hearer)
    assert failed == []
    assert f"{COMPILING}: {tellers * each} done" in hearer.heard


def test_what_is_compiled_is_not_compiled_again_and_nothing_is_said(tmp_path: Path) -> None:
    compile_once(tmp_path, lambda: None, counted_once, Hearer())
    hearer = Hearer()
    compile_once(tmp_path, lambda: pytest.fail("again"), counted_once, hearer)
    assert hearer.heard == []


def test_who_needs_other_kernels_does_not_wait_for_those_that_are_being_compiled(tmp_path: Path) -> None:
    compiled: list[str] = []

    def compile_scans() -> None:
        compile_once(tmp_path, lambda: compiled.append("terrain"), counted_once, Hearer(), "terrain")
        compiled.append("scans")

    compile_once(tmp_path, compile_scans, counted_once, Hearer(), "scans")
    assert compiled == ["terrain", "scans"]


def test_what_broke_off_is_compiled_by_the_next(tmp_path: Path) -> None:
    def break_off() -> None:
        raise MemoryError

    with pytest.raises(MemoryError):
        compile_once(tmp_path, break_off, counted_once, Hearer())
    compiled: list[int] = []
    compile_once(tmp_path, lambda: compiled.append(1), counted_once, Hearer())
    assert compiled == [1]


def test_kernels_are_counted_as_they_are_compiled() -> None:
    @njit
    def twice(value: float) -> float:
        return 2.0 * value

    told: list[int] = []
    with counted_kernels(lambda: told.append(1)):
        assert np.isclose(twice(1.5), 3.0)
    assert told


def test_a_computation_that_reads_strangers_files_leaves_no_kernels_to_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "left_kernels.py").write_text(
        "from numba import njit\n\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(Cache, "save_overload", Cache.save_overload)  # given back afterwards
    kernels_module: Any = importlib.import_module("left_kernels")
    keep_kernels_as_they_are()
    assert kernels_module.twice(21) == 42
    assert list(tmp_path.rglob("*.nb[ic]")) == []


def called_by_the_numerics(module: str, kernel: str) -> bool:
    """Tell whether a module that is not of kernels calls a kernel; others are compiled with those that call them."""
    texts = (path.read_text() for path in KERNELS.rglob("*.py") if not path.stem.endswith("_kernels"))
    return any(module.rpartition(".")[2] in text and re.search(rf"\b{kernel}\(", text) for text in texts)


@pytest.mark.slow
def test_each_kernel_that_the_numerics_call_is_practised_and_what_all_need_is_compiled_ahead() -> None:
    done = subprocess.run([sys.executable, "-c", NOT_CALLED], capture_output=True, text=True, check=True)
    called, left = map(json.loads, done.stdout.splitlines()[-2:])
    assert [(module, kernel) for module, kernel in left if called_by_the_numerics(module, kernel)] == []
    listed = json.loads(LISTED.read_text())
    assert [each for each in called if each not in listed] == [], WRITE


def test_each_kernel_that_is_compiled_ahead_exists() -> None:
    for module, kernel, _ in json.loads(LISTED.read_text()):
        path = KERNELS.parent / f"{module.replace('.', '/')}.py"
        assert re.search(rf"^def {kernel}\(", path.read_text(), re.MULTILINE), WRITE


@pytest.mark.slow
def test_several_processes_compile_what_is_listed_and_what_is_no_more_is_left_out(tmp_path: Path) -> None:
    names = ["once", "twice", "thrice"]
    text = "from numba import njit\n" + "".join(
        f"\n@njit(cache=True)\ndef {name}(x):\n    return {number} * x\n" for number, name in enumerate(names)
    )
    (tmp_path / "ahead_kernels.py").write_text(text)
    listed = [("ahead_kernels", name, ["float64"]) for name in [*names, "gone"]]
    listed += [("ahead_kernels", name, ["float64", "float64"]) for name in names]  # as if they had taken more before
    (tmp_path / "listed.json").write_text(json.dumps(listed))
    done = subprocess.run([sys.executable, "-c", AHEAD, tmp_path], capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("nobody is left\n", 0), done.stderr
    kept = {path.name.split(".")[1].split("-")[0] for path in tmp_path.rglob("*.nbi")}
    assert kept == set(names)


@pytest.mark.parametrize(
    ("step", "arguments", "parts"),
    [
        ("inspect-file", {}, []),
        ("features", {"photos": []}, [SCANS]),
        ("features", {"photos": [{}]}, [SCANS, EDGES_OF_PHOTOS, LINES_OF_PHOTOS]),
        ("register-pair", {"method": {"method": "auto"}}, [SCANS]),
        ("register-pair", {"method": {"method": "ndt"}}, [SCANS, METHODS]),
        ("compare-method", {"method": {"method": "planes-triples"}}, [SCANS, METHODS]),
        ("detect-edges", {"options": {}}, [EDGES_OF_PHOTOS]),
        ("clean-stations", {"options": {}}, [SCANS, CLOUDS]),
        ("write-registered", {"options": {"cleaning": None}}, [SCANS]),
        ("write-registered", {"options": {"cleaning": {"comet_tails": True}}}, [SCANS, CLOUDS]),
        ("adjust", {"options": None}, [NETWORKS]),
        ("adjust-network", {}, [SCANS, NETWORKS]),
        ("terrain", {"inputs": {}}, [TERRAIN]),
        ("model-roofs", {"plans": None}, [SCANS, TERRAIN, CLOUDS]),
        ("model-roofs", {"plans": [{}]}, [SCANS, CLOUDS]),
    ],
)
def test_a_step_waits_for_the_kernels_that_it_calls_only(step: str, arguments: Json, parts: list[str]) -> None:
    assert list(parts_of(step, arguments)) == parts
