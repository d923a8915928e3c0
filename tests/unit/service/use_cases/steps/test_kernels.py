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
from service.use_cases.steps.kernels import KERNELS, PRACTICES, import_kernels

import_kernels()
for practice in PRACTICES.values():
    practice()
modules = {name: module for name, module in sys.modules.items() if name.endswith("_kernels")}
named = {(name, word) for name, module in modules.items() for word, value in vars(module).items()
         if isinstance(value, Dispatcher) and value.__module__ == name and not value.signatures}
print(json.dumps(sorted(named)))
"""
"""Lists kernels that no practice called, and no other kernel of which they are part was compiled in this process."""


class Hearer:
    def __init__(self, enough: threading.Event | None = None) -> None:
        self.heard: list[str] = []
        self._enough = enough or threading.Event()

    def report(self, fraction: float, message: str) -> None:
        assert fraction == 0.0
        self.heard.append(message)
        self._enough.set()


@contextmanager
def counted_once(tell: Callable[[int], None]) -> Iterator[None]:
    tell(1)
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


def test_what_is_compiled_is_not_compiled_again_and_nothing_is_said(tmp_path: Path) -> None:
    compile_once(tmp_path, lambda: None, counted_once, Hearer())
    hearer = Hearer()
    compile_once(tmp_path, lambda: pytest.fail("again"), counted_once, hearer)
    assert hearer.heard == []


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
    with counted_kernels(told.append):
        assert np.isclose(twice(1.5), 3.0)
    assert told[-1] >= 1


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
def test_each_kernel_that_the_numerics_call_is_practised() -> None:
    done = subprocess.run([sys.executable, "-c", NOT_CALLED], capture_output=True, text=True, check=True)
    left = json.loads(done.stdout.splitlines()[-1])
    assert [(module, kernel) for module, kernel in left if called_by_the_numerics(module, kernel)] == []


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
        ("terrain", {"inputs": {}}, [TERRAIN]),
        ("model-roofs", {"plans": None}, [SCANS, TERRAIN, CLOUDS]),
        ("model-roofs", {"plans": [{}]}, [SCANS, CLOUDS]),
    ],
)
def test_a_step_waits_for_the_kernels_that_it_calls_only(step: str, arguments: Json, parts: list[str]) -> None:
    assert list(parts_of(step, arguments)) == parts
