"""Uploads whose client, API or whole service is killed at random offsets."""

import base64
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx
import laspy
import numpy as np
import psutil

from tests.e2e.running.running_service import Document, RunningService, wait_until
from tests.measures.patience import patience

TUS = {"Tus-Resumable": "1.0.0"}
PART = {**TUS, "Content-Type": "application/offset+octet-stream"}
BLOCK_BYTES = 1 << 22


def write_scan(path: Path, size: int) -> Path:
    """Write a scan of any size: what follows the points of a LAS file does not matter to its reader."""
    rng = np.random.default_rng(size)
    scan = laspy.create(point_format=0, file_version="1.2")
    scan.header.scales = np.full(3, 1e-4)
    scan.x, scan.y, scan.z = 10.0 * rng.random((3, 1000))
    scan.write(path)
    with path.open("ab") as file:
        while (left := size - file.tell()) > 0:
            file.write(rng.bytes(min(left, BLOCK_BYTES)))
    return path


def begun(service: RunningService, path: Path) -> str:
    """Begin an upload of a file; give its path on the server."""
    name = base64.b64encode(path.name.encode()).decode()
    headers = {**TUS, "Upload-Length": str(path.stat().st_size), "Upload-Metadata": f"filename {name}"}
    answer = service.post("/uploads", headers=headers)
    assert answer.status_code == 201, answer.text
    return httpx.URL(answer.headers["location"]).path


def finished(service: RunningService, upload: str, within_s: float = 60.0) -> Document:
    """Wait until an upload has become a file; give the file's document."""
    wait_until(lambda: service.http.get(upload).json()["status"] == "finished", within_s)
    answer = service.http.get(f"/files/{service.http.get(upload).json()['file']}")
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def upload_with_kills(
    service: RunningService, path: Path, victims: list[str], manner: str, rng: np.random.Generator
) -> Document:
    """Upload a file while the client, an API process or everything is killed at random offsets, one after the other."""
    size = path.stat().st_size
    upload = begun(service, path)
    for number, victim in enumerate(victims):
        # what is left is shared out so that the last kill still finds something under way
        share = 2.0 * rng.random() / (len(victims) + 1 - number)
        target = min(int((size - arrived(service, upload)) * share) + arrived(service, upload), size - 1)
        sender = start_sender(service, upload, path, manner)
        wait_until(lambda: arrived(service, upload) >= target, 120.0, every_s=0.001)  # noqa: B023
        if victim == "client":
            sender.kill()
        elif victim == "api":
            for api in service.apis():
                with suppress(psutil.NoSuchProcess):
                    api.kill()
            time.sleep(0.3)  # and the client tries again
            sender.kill()
        else:
            service.kill_everything()
            sender.kill()
            service.start()
        sender.wait()
    sender = start_sender(service, upload, path, manner)
    assert sender.wait(300.0 * patience()) == 0
    return finished(service, upload)


def start_sender(service: RunningService, upload: str, path: Path, manner: str) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "tests.e2e.files.tus_sender", f"{service.url}{upload}", str(path), manner]
    return subprocess.Popen(command, cwd=Path(__file__).parents[3], stderr=subprocess.DEVNULL)


def arrived(service: RunningService, upload: str) -> int:
    """Give the size of an upload's file on disk; that of the whole when it is finished."""
    folder = service.data / upload.removeprefix("/")
    try:
        return (folder / "content").stat().st_size
    except FileNotFoundError:
        return sys.maxsize


@contextmanager
def watched_memory(service: RunningService) -> Iterator[list[int]]:
    """Note the largest resident memory of the API processes [bytes] while something happens."""
    largest, stop = [0], threading.Event()

    def watch() -> None:
        while not stop.wait(0.05):
            with suppress(psutil.NoSuchProcess):
                largest[0] = max([largest[0], *(api.memory_info().rss for api in service.apis())])

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield largest
    finally:
        stop.set()
        watcher.join()
