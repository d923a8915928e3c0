"""Check array shapes and types of the numerics (jaxtyping + beartype) in every test run."""

import os
from collections.abc import Iterator
from pathlib import Path

# Before numpy is loaded: matrices of some hundred rows gain nothing from threads, and lose much where tests run side
# by side. The service sets the same for its computations.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest
from jaxtyping import install_import_hook

from tests.servers.databases import new_database, postgres
from tests.servers.object_server import objects

__all__ = ["new_database", "objects", "postgres"]

# no test depends on wall time: beside other load anything takes long
hypothesis.settings.register_profile("without deadlines", deadline=None)
hypothesis.settings.load_profile("without deadlines")

ROOT = Path(__file__).resolve().parent.parent
BY_OPEN3D = (
    "unit/algorithms/meshing",
    "unit/algorithms/cleaning/test_smoothing.py",
    "unit/algorithms/cleaning/test_comet_tails.py",
    "unit/service/formats/test_writers.py",
)
"""Tests of what open3d computes; all others must need no library of the system."""
LONG_FIRST = ("integration", "e2e", "property", "reference")
"""Rooms whose files take longest: with them at the end, all but one of the processes would wait for the last file."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes long; within a room the order stays."""

    def place(item: pytest.Item) -> int:
        room = item.path.relative_to(ROOT / "tests").parts[0]
        return LONG_FIRST.index(room) if room in LONG_FIRST else len(LONG_FIRST)

    items.sort(key=place)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> object:
    """Skip what open3d computes where this machine lacks a library that it needs."""
    return (yield from _by_open3d(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> object:
    """Skip likewise what meets it later."""
    return (yield from _by_open3d(item))


def _by_open3d(item: pytest.Item) -> Iterator[None]:
    from algorithms.errors import MissingLibraryError

    try:
        result = yield
    except MissingLibraryError as missing:
        if not any(item.path.is_relative_to(ROOT / "tests" / place) for place in BY_OPEN3D):
            raise
        pytest.skip(str(missing))
    return result


def _checked_modules() -> list[str]:
    """List the modules of `algorithms` except numba kernels, which must stay plain functions to be compiled."""
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in sorted((ROOT / "algorithms").rglob("*.py"))
        if path.name != "__init__.py" and not path.stem.endswith("_kernels")
    ]


install_import_hook(_checked_modules(), "beartype.beartype")
