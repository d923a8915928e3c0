"""kill -9 of client, API and the whole service at random offsets of an upload: the file arrives as it was sent."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.e2e.files.broken_uploads import upload_with_kills, watched_memory, write_scan
from tests.e2e.running.running_service import RunningService, running_service

pytestmark = pytest.mark.service


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    with running_service(tmp_path_factory.mktemp("killed_uploads"), API_PROCESSES="2") as running:
        yield running


@pytest.mark.parametrize(("manner", "size"), [("tuspy", 100_000_001), ("whole", 99_999_999)])
def test_an_upload_survives_kills(service: RunningService, tmp_path: Path, manner: str, size: int) -> None:
    path = write_scan(tmp_path / "large.las", size)
    victims = ["client", "api", "everything", "api", "client"]
    with watched_memory(service) as largest:
        file = upload_with_kills(service, path, victims, manner, np.random.default_rng(size))
    with path.open("rb") as sent:
        assert file["sha256"] == hashlib.file_digest(sent, "sha256").hexdigest()
    assert 50e6 < largest[0] < 150e6
    left = {name for name in service.stored() if file["sha256"] not in name and not name.endswith("/upload.json")}
    assert left == set()
    service.http.delete(f"/files/{file['id']}")
    path.unlink()
