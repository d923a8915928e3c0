"""What a computing process is told from its start."""

from pathlib import Path

import pytest

from service.adapters.processes.child_process import environment
from service.settings import Settings


@pytest.mark.parametrize("library", ["OMP", "NUMBA", "RAYON"])
def test_libraries_take_as_many_threads_as_a_computation_may(tmp_path: Path, library: str) -> None:
    told = environment(Settings(data_dir=tmp_path, threads=3))
    assert told[f"{library}_NUM_THREADS"] == "3"
