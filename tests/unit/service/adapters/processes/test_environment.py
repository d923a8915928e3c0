"""What a computing process is told from its start."""

from pathlib import Path

import pytest

from service.adapters.processes.child_process import _unneeded_by, environment
from service.settings import Settings


@pytest.mark.parametrize("library", ["OMP", "NUMBA", "RAYON"])
def test_libraries_take_as_many_threads_as_a_computation_may(tmp_path: Path, library: str) -> None:
    told = environment(Settings(data_dir=tmp_path, threads=3))
    assert told[f"{library}_NUM_THREADS"] == "3"


def test_settings_of_many_workers_hold_in_a_computation_that_knows_no_database() -> None:
    settings = Settings(workers=2, database_url="postgresql://somewhere/tieline")
    handed = settings.model_dump(mode="json", exclude=_unneeded_by("echo"))
    assert Settings(**handed).database_url == ""
