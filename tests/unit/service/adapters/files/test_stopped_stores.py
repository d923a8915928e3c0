"""A neighbour that is stopped, and not dead, is told apart within seconds: it takes connections and never answers."""

import socket
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from service.adapters.files import object_files
from service.adapters.files.object_files import ObjectFiles
from service.errors import InsufficientStorageError, StorageError
from service.routes.problems import away
from service.settings import Settings
from service.use_cases.limits import check_readiness as readiness
from tests.doubles.memory import MemoryBlobStore, MemoryJobStore, MemoryQueue
from tests.servers.object_server import CREDENTIALS


@pytest.fixture
def stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ObjectFiles]:
    monkeypatch.setattr(object_files, "ANSWERS_WITHIN_S", 1.0)
    for name, value in CREDENTIALS.items():
        monkeypatch.setenv(name, value)
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"http://127.0.0.1:{server.getsockname()[1]}"
        yield ObjectFiles(Settings(data_dir=tmp_path, storage_url=f"s3://bucket/folder?endpoint={endpoint}"))


CALLS: dict[str, Callable[[ObjectFiles, Path], object]] = {
    "small content": lambda store, _: store.write_bytes("jobs/a/b.json", b"content"),
    "a file": lambda store, path: store.put_file("jobs/a/c.bin", path),
    "blocks": lambda store, _: store.put_stream("jobs/a/d.bin", iter([b"1" * 10])),
    "another name": lambda store, _: store.move("jobs/a/b.json", "jobs/a/e.json"),
    "a copy here": lambda store, _: store.local_path("jobs/a/b.json"),
    "a list": lambda store, _: store.keys("jobs/"),
    "a removal": lambda store, _: store.delete_prefix("jobs/a"),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS.keys())
def test_an_object_store_that_never_answers_is_given_up(
    stopped: ObjectFiles, tmp_path: Path, call: Callable[[ObjectFiles, Path], object]
) -> None:
    path = tmp_path / "file.bin"
    path.write_bytes(b"1" * 100)
    with pytest.raises(StorageError, match="cannot be used") as told:
        call(stopped, path)
    assert told.value.headers() == {"Retry-After": "10"}


def test_readiness_does_not_wait_for_who_never_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readiness, "ANSWERS_WITHIN_S", 0.2)
    never = threading.Event()

    class Stopped(MemoryBlobStore):
        def write_bytes(self, key: str, data: bytes) -> None:  # noqa: ARG002 - nothing is written
            never.wait(60.0)

    try:
        found = readiness.check_readiness(MemoryJobStore(), Stopped(), MemoryQueue(workers=1))
    finally:
        never.set()
    assert found.status == "not-ready"
    assert found.checks["storage"].detail == "does not answer within 0.2 s"
    assert found.checks["database"].ok


@pytest.mark.parametrize(
    ("words", "kind", "told"),
    [
        ("database or disk is full", InsufficientStorageError, "the disk of the database is full"),
        (
            "could not extend: No space left on device",
            InsufficientStorageError,
            "the disk of the database is full",
        ),
        ("database is locked", StorageError, "the database is busy"),
        ("connection refused", StorageError, "the database does not answer"),
    ],
)
def test_what_is_wrong_with_the_database_is_said(words: str, kind: type[Exception], told: str) -> None:
    error: Any = OperationalError("INSERT", {}, sqlite3.OperationalError(words))
    answer = away(error, "/jobs")
    assert isinstance(answer, kind)
    assert told in str(answer)
