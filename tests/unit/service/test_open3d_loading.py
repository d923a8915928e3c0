"""open3d is loaded where next to nothing of the machine may be read, and its absence is said in a sentence."""

import ctypes
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from algorithms.errors import MissingLibraryError
from algorithms.scans.open3d_loading import import_open3d, missing_for_open3d
from service.errors import InvalidRequestError, to_problem
from service.ports import Stored
from service.processes import OFFERED_PROCESSES
from service.settings import Settings
from service.use_cases.jobs.submit_job import check_execution
from service.use_cases.limits.check_readiness import check_readiness
from tests.doubles.memory import MemoryBlobStore, MemoryFileStore, MemoryJobStore, MemoryQueue

CONFINED = """
import mimetypes
import sys

def refuse(self, filename, strict=True):
    raise PermissionError(filename)

mimetypes.MimeTypes.read = refuse
from algorithms.scans.open3d_loading import import_open3d
assert import_open3d().__name__ == "open3d"
assert not {"dash", "plotly", "flask"} & sys.modules.keys()
"""


@pytest.mark.skipif(missing_for_open3d() is not None, reason=str(missing_for_open3d()))
def test_the_viewer_for_notebooks_is_left_out_which_asks_for_the_media_types_of_the_system() -> None:
    done = subprocess.run([sys.executable, "-c", CONFINED], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def no_egl(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Load no `libEGL.so.1`, as on a machine that has none."""
    load = ctypes.CDLL

    def without(name: str, *arguments: Any, **more: Any) -> ctypes.CDLL:
        if name == "libEGL.so.1":
            raise OSError("libEGL.so.1: cannot open shared object file: No such file or directory")
        return load(name, *arguments, **more)

    monkeypatch.setattr(ctypes, "CDLL", without)
    for each in (missing_for_open3d, import_open3d):
        each.cache_clear()
    yield
    for each in (missing_for_open3d, import_open3d):
        each.cache_clear()


@pytest.mark.skipif(sys.platform != "linux", reason="wheels of other systems bring their libraries")
@pytest.mark.usefixtures("no_egl")
def test_a_missing_library_is_named_with_the_packages_that_bring_it() -> None:
    with pytest.raises(MissingLibraryError, match=r"libEGL\.so\.1.*libegl1 \(Debian.*libglvnd-egl \(RHEL") as raised:
        import_open3d()
    problem = to_problem(raised.value)
    assert (problem["status"], problem["title"]) == (501, "Cannot be computed here")


@pytest.mark.skipif(sys.platform != "linux", reason="wheels of other systems bring their libraries")
@pytest.mark.usefixtures("no_egl")
def test_a_request_that_needs_open3d_is_refused_where_a_library_is_missing_and_others_are_not(tmp_path: Path) -> None:
    stored = Stored(MemoryFileStore(), MemoryJobStore(), Settings(data_dir=tmp_path))
    stations = [{"name": "S", "scan": {"file": "f"}}]
    for process, more in (("mesh", {}), ("clean", {"cleaning": {"smoothing": {}}})):
        with pytest.raises(MissingLibraryError):
            check_execution(OFFERED_PROCESSES[process], {"inputs": {"stations": stations, **more}}, stored)
    with pytest.raises(InvalidRequestError):  # only for the file that is not there
        check_execution(OFFERED_PROCESSES["clean"], {"inputs": {"stations": stations}}, stored)
    ready = check_readiness(stored.jobs, MemoryBlobStore(), MemoryQueue(workers=1))
    assert ready.status == "ready"
    assert "meshes" in ready.checks["open3d"].detail


def test_scans_are_simulated_without_open3d() -> None:
    script = """
import sys
sys.modules["open3d"] = None  # importing it fails
import numpy as np
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
scene = SCENES["house"]()
scanner = VirtualScanner(rows=60, columns=180)
scans = simulate_stations(scene, scene.stations[:2], scanner, np.random.default_rng(5))
assert min(map(len, scans)) > 1000
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
