"""The disk of the data directory is full while files come and jobs run: it is said in words, and nothing is lost."""

import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np
import pytest

from tests.e2e.running.running_service import RunningService, alive, wait_until

pytestmark = pytest.mark.service

MEGABYTES = 16
"""Of the disk: what the service itself needs, and a few files."""
LATER = {"Prefer": "respond-async"}
TUS = {"Tus-Resumable": "1.0.0", "Upload-Metadata": "filename YS5wbHk="}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    home = tmp_path_factory.mktemp("full")
    running = RunningService(home, {"MIN_FREE_BYTES": "0", "WORKERS": "1", "SLOTS": "1"})
    running.data.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={MEGABYTES}m,mode=0700", "tmpfs", str(running.data)],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.strip()}")
    try:
        running.start()
        try:
            yield running
        finally:
            running.stop()
    finally:
        subprocess.run(["umount", "--lazy", str(running.data)], check=True)


def cloud(points: int) -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {points}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    return head.encode() + np.random.default_rng(points).random((points, 3), dtype=np.float32).tobytes()


def is_full(answer: httpx.Response) -> bool:
    """Say whether an answer tells that the disk is full, as a problem document."""
    told = answer.headers["content-type"].startswith("application/problem+json") and "disk" in answer.json()["detail"]
    return told and (answer.status_code == 507 or (answer.status_code == 503 and "Retry-After" in answer.headers))


@contextmanager
def filled(directory: Path) -> Iterator[None]:
    """Fill the disk of a directory to the last block."""
    ballast = directory / "ballast"
    try:
        with ballast.open("wb") as file:
            for size in (1 << 16, 1):
                try:
                    while True:
                        os.write(file.fileno(), bytes(size))
                except OSError:
                    continue
        yield
    finally:
        ballast.unlink()


def test_an_upload_that_does_not_fit_is_refused_and_leaves_nothing(service: RunningService) -> None:
    small = service.post("/files", files={"file": ("small.ply", cloud(2000))})
    assert small.status_code == 201, small.text
    before, files = service.stored(), service.get("/files").json()["files"]
    large = cloud(1_600_000)
    assert len(large) > MEGABYTES << 20
    form = service.post("/files", files={"file": ("large.ply", large)})
    raw = service.post("/files", content=large, headers={"Content-Disposition": 'attachment; filename="large.ply"'})
    begun = service.post("/uploads", headers={**TUS, "Upload-Length": str(len(large))})
    answers = [form, raw]
    if begun.status_code == 201:
        head = {**TUS, "Content-Type": "application/offset+octet-stream", "Upload-Offset": "0"}
        answers.append(service.http.patch(begun.headers["location"], content=large, headers=head))
        assert service.http.delete(begun.headers["location"], headers=TUS).status_code == 204
    else:
        answers.append(begun)
    assert [each.text for each in answers if not is_full(each)] == []
    assert service.get("/files").json()["files"] == files
    wait_until(lambda: service.stored() == before, 20.0)
    assert service.get(f"/files/{small.json()['id']}/content").content == cloud(2000)


def test_while_the_disk_is_full_all_is_refused_in_words_and_afterwards_all_goes_on(service: RunningService) -> None:
    lasting = service.lasting_processes()
    known = service.execute("echo", {"stringInput": "before"}, **LATER)
    assert service.result(known) == {"stringInput": "before"}
    jobs = [service.execute("echo", {"stringInput": str(k), "pause": 4}, **LATER) for k in range(2)]
    wait_until(lambda: service.job(jobs[0])["status"] == "running")
    with filled(service.data):
        deadline = time.monotonic() + 12.0  # until the first job would have been done, and its end is not kept
        while time.monotonic() < deadline:
            assert httpx.get(f"{service.url}/healthz", timeout=60.0).status_code == 200
            assert service.get(f"/jobs/{known}/results").json() == {"stringInput": "before"}
            told = [
                service.post("/files", files={"file": ("a.ply", cloud(3000))}),
                service.post("/uploads", headers={**TUS, "Upload-Length": "100000"}),
                service.post("/processes/echo/execution", json={"inputs": {"stringInput": "x"}}, headers=LATER),
            ]
            assert [f"{each.status_code} {each.text}" for each in told if not is_full(each)] == []
            ready = httpx.get(f"{service.url}/readyz", timeout=60.0)
            assert ready.status_code == 503, ready.text
            time.sleep(1.0)
        assert service.lasting_processes() == lasting
    for number, job in enumerate(jobs):
        ended = service.finished(job)
        print(f"{ended['status']}: {ended['message']}")
        if ended["status"] == "successful":
            assert service.get(f"/jobs/{job}/results").json()["stringInput"] == str(number)
        else:
            problem = service.get(f"/jobs/{job}/results")
            assert problem.json()["status"] == 507, problem.text
            assert "disk" in problem.json()["detail"]
    wait_until(lambda: httpx.get(f"{service.url}/readyz", timeout=60.0).status_code == 200, 30.0)
    assert service.echo()
    assert service.post("/files", files={"file": ("again.ply", cloud(2500))}).status_code == 201
    assert service.lasting_processes() == lasting


def test_an_api_process_that_dies_while_the_disk_is_full_is_there_again(service: RunningService) -> None:
    """What it maps into memory has its blocks, or it would be killed at once, again and again."""
    with filled(service.data):
        (first,) = service.apis()
        first.kill()
        wait_until(lambda: not alive(first) and service.answers(), 60.0)
        (second,) = service.apis()
        for path in ("/", "/jobs", "/files", "/processes", "/metrics", "/nothing"):
            answer = httpx.get(service.url + path, timeout=60.0)
            assert answer.status_code in {200, 404} or is_full(answer), answer.text
        assert alive(second)
    assert service.echo()
    assert "service.launcher" in " ".join(second.cmdline())
    assert alive(second)
