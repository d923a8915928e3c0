"""Uploads of 2 GiB: 20 kills on the way by tus, and the memory of the service for every way of sending and of storage.

Run with ``pytest -n0 -s -m benchmark tests/benchmark/test_upload_kills.py``; needs 12 GB of disk.
"""

import hashlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from tests.e2e.files.broken_uploads import begun, finished, start_sender, upload_with_kills, watched_memory, write_scan
from tests.e2e.files.tus_sender import blocks
from tests.e2e.running.running_service import RunningService, running_service
from tests.servers.object_server import ObjectServer

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1200)]
SIZE = 2 << 30
VICTIMS = ["client", "api", "client", "api", "everything"] * 4


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scan(tmp_path_factory.mktemp("large") / "large.las", SIZE)


@pytest.fixture(scope="module")
def sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("service")) as running:
        yield running


@pytest.fixture(scope="module")
def storing_elsewhere(tmp_path_factory: pytest.TempPathFactory, objects: ObjectServer) -> Iterator[RunningService]:
    """Run a service whose files are in an object store."""
    settings = {"WORKERS": "1", "STORAGE_URL": objects.new_place()}
    running = RunningService(tmp_path_factory.mktemp("elsewhere"), settings, environment=objects.credentials)
    running.start()
    yield running
    running.stop()


def by_tus(service: RunningService, path: Path) -> dict[str, Any]:
    upload = begun(service, path)
    assert start_sender(service, upload, path, "whole").wait() == 0
    return finished(service, upload)


def by_body(service: RunningService, path: Path) -> dict[str, Any]:
    headers = {"Content-Disposition": f'attachment; filename="{path.name}"', "Content-Length": str(SIZE)}
    answer = httpx.post(f"{service.url}/files", headers=headers, content=blocks(path, 0), timeout=300.0)
    return dict(answer.raise_for_status().json())


def by_form(service: RunningService, path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        answer = httpx.post(f"{service.url}/files", files={"file": (path.name, file)}, timeout=300.0)
    return dict(answer.raise_for_status().json())


@pytest.mark.parametrize("send", [by_tus, by_body, by_form])
@pytest.mark.parametrize("storage", ["service", "storing_elsewhere"])
def test_memory_does_not_depend_on_the_size(
    request: pytest.FixtureRequest,
    storage: str,
    path: Path,
    sha256: str,
    send: Callable[[RunningService, Path], dict[str, Any]],
) -> None:
    service: RunningService = request.getfixturevalue(storage)
    with watched_memory(service) as largest:
        begin = time.perf_counter()
        file = send(service, path)
        took_s = time.perf_counter() - begin
    print(f"\n{storage}, {send.__name__}: {largest[0] / 1e6:.0f} MB of memory, {took_s:.1f} s")
    assert service.http.delete(f"/files/{file['id']}").status_code == 204
    assert file["sha256"] == sha256
    assert largest[0] < 150e6


@pytest.mark.parametrize("manner", ["tuspy", "whole"])
def test_twenty_kills_do_no_harm(service: RunningService, path: Path, sha256: str, manner: str) -> None:
    with watched_memory(service) as largest:
        file = upload_with_kills(service, path, VICTIMS, manner, np.random.default_rng(20))
    print(f"\n{len(VICTIMS)} kills, {manner}: {largest[0] / 1e6:.0f} MB of memory")
    assert service.http.delete(f"/files/{file['id']}").status_code == 204
    assert file["sha256"] == sha256
    assert largest[0] < 150e6
    assert not [name for name in service.stored() if not name.endswith("/upload.json")]
