"""The same job gives the same result document, whatever it runs on: workers, computations side by side, threads."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from algorithms.scans.point_blocks import blocks_of
from algorithms.simulation.scanner import VirtualScanner
from algorithms.simulation.scanning import simulate_stations
from algorithms.simulation.scenes import SCENES
from tests.e2e.answers import of_the_scans
from tests.e2e.running.running_service import Document, RunningService, running_service
from tests.e2e.running.virtual_scans import write_scans

pytestmark = pytest.mark.service

MACHINES = {
    "one after the other on one thread": {"WORKERS": "1", "SLOTS": "1", "THREADS": "1"},
    "side by side with two threads each": {"SLOTS": "2", "THREADS": "2"},
}


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """Three scans of some 140 thousand points: more than one block of what is shared among threads."""
    scene = SCENES["house"]()
    scanner = VirtualScanner(rows=380, columns=900)
    scans = list(simulate_stations(scene, scene.stations[:3], scanner, np.random.default_rng(1)))
    return write_scans(tmp_path_factory.mktemp("house"), scans)


def registered(service: RunningService, files: Sequence[Document]) -> bytes:
    """Register the scans and give the stored result document."""
    stations = [{"name": f"S{k}", "scan": {"file": file["id"]}} for k, file in enumerate(files, start=1)]
    job = service.execute("register", {"stations": stations})
    assert [station["status"] for station in service.result(job)["stations"]][:2] == ["fixed", "registered"]
    answer = service.http.get(f"/jobs/{job}/artifacts/result.json")
    assert answer.status_code == 200
    return answer.content


@pytest.fixture(scope="module")
def documents(house: Sequence[Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[bytes]]:
    """A run on each machine, and on the first another one with the features of the first run."""
    found: dict[str, list[bytes]] = {}
    for number, (name, settings) in enumerate(MACHINES.items()):
        with running_service(tmp_path_factory.mktemp(f"machine-{number}"), **settings) as service:
            files = [service.upload(path) for path in house]
            assert all(len(blocks_of(file["scans"][0]["points"])) > 1 for file in files)
            found[name] = [registered(service, files) for _ in range(2 - number)]
    return found


def test_two_runs_on_one_machine_give_the_same_bytes(documents: dict[str, list[bytes]]) -> None:
    first, second = next(iter(documents.values()))
    assert of_the_scans(first) == of_the_scans(second)


def test_workers_and_threads_do_not_show_in_the_result(documents: dict[str, list[bytes]]) -> None:
    alone, together = documents.values()
    assert of_the_scans(alone[0]) == of_the_scans(together[0])
