"""Two services with nothing in common but a PostgreSQL database and an object store: one registration through both."""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import httpx
import numpy as np
import pytest

from tests.e2e.running.running_service import Document, RunningService, alive, wait_until
from tests.e2e.running.virtual_scans import first_from_second, simulate, write_scans
from tests.servers.object_server import ObjectServer
from tests.servers.postgres_server import PostgresServer, postgres_server

pytestmark = pytest.mark.service

TUS = {"Tus-Resumable": "1.0.0"}


@pytest.fixture(scope="module")
def server() -> Iterator[PostgresServer]:
    with postgres_server() as made:
        yield made


@pytest.fixture(scope="module")
def machines(
    tmp_path_factory: pytest.TempPathFactory, server: PostgresServer, objects: ObjectServer
) -> Iterator[Sequence[RunningService]]:
    settings = {"SLOTS": "1", "DATABASE_URL": server.new_database(), "STORAGE_URL": objects.new_place()}
    made = [
        RunningService(tmp_path_factory.mktemp(name), settings, environment=objects.credentials)
        for name in ("here", "there")
    ]
    for each in made:
        each.start()
    yield made
    for each in made:
        each.stop()


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    return write_scans(tmp_path_factory.mktemp("house"), simulate("house"))


def stations_of(machines: Sequence[RunningService], scans: Sequence[Path], std_m: float = 0.002) -> list[Document]:
    """Upload one scan to each machine; with another noise, features are computed anew."""
    files = [machine.upload(path)["id"] for machine, path in zip(machines, scans, strict=True)]
    return [
        {"name": f"S{k + 1}", "scan": {"file": file, "index": 0}, "point_std_m": std_m} for k, file in enumerate(files)
    ]


def assert_right(result: Document) -> None:
    shift = np.array(result["stations"][1]["world_from_scan"]["matrix"])[:3, 3]
    np.testing.assert_allclose(shift, first_from_second("house").translation, atol=0.005)


def test_what_one_machine_takes_the_other_gives_back(machines: Sequence[RunningService], scans: Sequence[Path]) -> None:
    here, there = machines
    stations = stations_of(machines, scans)
    file = stations[0]["scan"]["file"]
    content = there.http.get(f"/files/{file}/content")
    part = there.http.get(f"/files/{file}/content", headers={"Range": "bytes=100-199"})
    expected = scans[0].read_bytes()
    assert hashlib.sha256(content.content).digest() == hashlib.sha256(expected).digest()
    assert (part.status_code, part.content) == (206, expected[100:200])

    job = here.execute("register", {"stations": stations})
    result = there.result(job)
    assert_right(result)
    report = next(each for each in result["artifacts"] if each["name"] == "report.html")
    answers = [machine.http.get(f"/jobs/{job}/artifacts/report.html") for machine in machines]
    assert [len(each.content) for each in answers] == [report["bytes"]] * 2
    assert (there.http.delete(f"/jobs/{job}").status_code, here.http.get(f"/jobs/{job}").status_code) == (200, 404)


def test_a_resumable_upload_goes_on_through_any_machine(
    machines: Sequence[RunningService], scans: Sequence[Path]
) -> None:
    content = scans[0].read_bytes()
    headers = {**TUS, "Upload-Length": str(len(content)), "Upload-Metadata": "filename aG91c2UuZTU3"}
    begun = machines[0].http.post("/uploads", headers=headers)
    path = httpx.URL(begun.headers["location"]).path
    offset = 0
    for number, size in enumerate((len(content) // 5, len(content) // 3, len(content) // 4, len(content))):
        part = {**TUS, "Content-Type": "application/offset+octet-stream", "Upload-Offset": str(offset)}
        answer = machines[number % 2].http.patch(path, headers=part, content=content[offset : offset + size])
        assert answer.status_code == 204, answer.text
        offset = int(machines[(number + 1) % 2].http.head(path, headers=TUS).headers["upload-offset"])
        if number == 1:
            killed = machines[0].apis()[0]
            killed.kill()
            wait_until(lambda: not alive(killed), 5.0)  # noqa: B023
            wait_until(machines[0].answers)
    assert offset == len(content)
    file = path.rpartition("/")[2]
    answers = [machine.http.get(f"/files/{file}/content").content for machine in machines]
    assert answers == [content, content]
    assert machines[0].http.delete(f"/files/{file}").status_code == 204


def test_a_machine_goes_on_with_what_another_had_begun_when_it_died(
    machines: Sequence[RunningService], scans: Sequence[Path]
) -> None:
    here, there = machines
    jobs = [here.execute("register", {"stations": stations_of(machines, scans, std_m)}) for std_m in (0.0021, 0.0022)]
    wait_until(lambda: here.computations() != [], every_s=0.02)
    here.kill_everything()
    try:
        results = [there.result(job) for job in jobs]
    finally:
        here.start()
    for result in results:
        assert_right(result)
    assert list((here.data / "scratch").iterdir()) == []


def test_the_service_outlasts_an_outage_of_its_database(
    machines: Sequence[RunningService], scans: Sequence[Path], server: PostgresServer
) -> None:
    here, there = machines
    lasting = [machine.lasting_processes() for machine in machines]
    job = here.execute("register", {"stations": stations_of(machines, scans, 0.0023)})
    wait_until(lambda: here.computations() != [] or there.computations() != [], every_s=0.02)
    server.kill()
    answers = [
        (machine.http.get("/readyz").status_code, machine.http.get(f"/jobs/{job}").status_code) for machine in machines
    ]
    alive = here.http.get("/healthz").status_code
    server.start()
    assert (answers, alive) == ([(503, 503)] * 2, 200)
    wait_until(lambda: all(machine.http.get("/readyz").status_code == 200 for machine in machines), 30.0)
    assert_right(there.result(job))
    assert (there.job(job)["attempts"], [machine.lasting_processes() for machine in machines]) == (1, lasting)


def test_connections_to_the_database_are_few(machines: Sequence[RunningService], server: PostgresServer) -> None:
    assert len(machines) == 2
    assert server.connections() <= 2 * 2 * (8 + 8 + 2)
