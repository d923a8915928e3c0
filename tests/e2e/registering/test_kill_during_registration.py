"""kill -9 in the middle of a registration: it goes on to the right result, and finished steps are not repeated."""

from collections.abc import Iterator, Sequence

import numpy as np
import psutil
import pytest

from service.adapters.processes.nursery import SCOUT
from service.formats.writers import write_scans
from tests.e2e.running.running_service import Document, RunningService, alive, running_service, wait_until
from tests.e2e.running.virtual_scans import first_from_second, simulate

pytestmark = pytest.mark.service


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("killed")) as running:
        yield running


@pytest.fixture(scope="module")
def stations(service: RunningService, tmp_path_factory: pytest.TempPathFactory) -> Sequence[Document]:
    path = tmp_path_factory.mktemp("house") / "house.e57"
    write_scans(path, simulate("house"))
    file = service.upload(path)["id"]
    return [{"name": f"S{k + 1}", "scan": {"file": file, "index": k}} for k in range(2)]


def comparing(service: RunningService, job: str) -> Sequence[psutil.Process]:
    """Wait until the job compares its scans; give the computing process."""
    wait_until(lambda: service.job(job)["message"].startswith("registering S2 to S1: "), every_s=0.02)
    return computing(service)


def computing(service: RunningService, *others: psutil.Process) -> Sequence[psutil.Process]:
    """Wait for a computing process other than those known; give it."""
    wait_until(lambda: [each for each in service.computations() if each not in others] != [])
    return [each for each in service.computations() if each not in others]


def all_ended(processes: Sequence[psutil.Process]) -> bool:
    return not any(alive(each) for each in processes)


def feature_files(service: RunningService) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (service.data / "blobs" / "features").rglob("*.npz")}


def test_a_job_survives_the_death_of_its_computation_of_its_worker_and_of_the_whole_service(
    service: RunningService, stations: Sequence[Document]
) -> None:
    job = service.execute("register", {"stations": stations})

    (first,) = comparing(service, job)
    features = feature_files(service)
    first.kill()
    (second,) = computing(service, first)
    service.worker().kill()
    wait_until(lambda: all_ended([second]), 5.0)
    computing(service)
    service.kill_everything()
    service.start()

    result = service.result(job)
    assert (result["status"], service.job(job)["attempts"]) == ("registered", 3)
    shift = np.array(result["stations"][1]["world_from_scan"]["matrix"])[:3, 3]
    np.testing.assert_allclose(shift, first_from_second("house").translation, atol=0.005)
    # a second extraction would have found the file of the first one and taken no time
    assert result["provenance"]["timings_s"]["features"] > 0.0
    assert (feature_files(service), list((service.data / "scratch").iterdir())) == (features, [])


def test_dismissing_ends_the_computation_within_five_seconds_and_leaves_nothing(
    service: RunningService, stations: Sequence[Document]
) -> None:
    before = service.stored()
    job = service.execute("register", {"stations": stations})
    computations = comparing(service, job)
    answer = service.http.delete(f"/jobs/{job}")
    assert (answer.status_code, answer.json()["status"], len(computations)) == (200, "dismissed", 1)
    wait_until(lambda: all_ended(computations) and service.computations() == [], 5.0)
    assert (service.stored(), service.job(job)["status"]) == (before, "dismissed")
    assert service.echo()


def test_sigterm_in_the_middle_of_a_job_leaves_no_process(
    service: RunningService, stations: Sequence[Document]
) -> None:
    comparing(service, service.execute("register", {"stations": stations}))
    family = service.processes()  # launcher, API, worker, its nursery, the computation, perhaps a scout
    at_work = [process for process in family if process.name() != SCOUT]
    assert (len(at_work), service.stop(), all_ended(family)) == (5, 0, True)
