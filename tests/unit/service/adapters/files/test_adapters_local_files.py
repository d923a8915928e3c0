"""Stores of blobs, local and remote: whole or not at all, and nothing outside their directory."""

import asyncio
import hashlib
from collections.abc import AsyncIterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from service.adapters.files.local_files import LocalFiles
from service.adapters.files.object_files import blob_store
from service.errors import FileTooLargeError, StorageError
from service.ports import BlobStore
from service.settings import Settings
from tests.doubles.memory import MemoryBlobStore


@pytest.fixture(params=["local", "file", "memory", pytest.param("s3", marks=pytest.mark.service)])
def blobs(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BlobStore:
    if request.param == "memory":
        return MemoryBlobStore()
    place = {"local": "", "file": f"file://{tmp_path}/shared"}.get(request.param)
    if place is None:
        server = request.getfixturevalue("objects")
        place = server.new_place()
        for name, value in server.credentials.items():
            monkeypatch.setenv(name, value)
    return blob_store(Settings(data_dir=tmp_path / "here", storage_url=place))


async def chunks(*parts: bytes, then: Exception | None = None) -> AsyncIterator[bytes]:
    for part in parts:
        yield part
    if then is not None:
        raise then


def leftovers(directory: Path) -> list[Path]:
    return [path for path in directory.rglob("*") if path.is_file()]


def test_a_stream_is_stored_with_its_size_and_hash(blobs: BlobStore) -> None:
    size, digest = asyncio.run(blobs.write_stream("files/a", chunks(b"x" * 700_000, b"y" * 700_000), 2_000_000))
    data = blobs.local_path("files/a").read_bytes()
    assert blobs.size("files/a") == len(data)
    assert (size, digest) == (len(data), hashlib.sha256(data).hexdigest())


def test_a_broken_stream_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ConnectionError):
        asyncio.run(LocalFiles(tmp_path).write_stream("files/a", chunks(b"abc", then=ConnectionError()), 100))
    assert leftovers(tmp_path) == []


def test_a_stream_above_the_limit_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(FileTooLargeError):
        asyncio.run(LocalFiles(tmp_path).write_stream("files/a", chunks(b"x" * 60, b"x" * 60), 100))
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("key", ["../a", "/etc/passwd", "a/../../b", "a//b", "", "a\x00b", ".hidden", "a/.."])
def test_keys_that_could_leave_the_store_are_refused(blobs: BlobStore, key: str) -> None:
    with pytest.raises(StorageError):
        blobs.write_bytes(key, b"")


def test_keys_are_listed_by_prefix(blobs: BlobStore) -> None:
    for key in ("jobs/1/result.json", "jobs/1/lines.ply", "jobs/12/result.json"):
        blobs.write_bytes(key, b"{}")
    assert blobs.keys("jobs/1/") == ["jobs/1/lines.ply", "jobs/1/result.json"]
    assert (blobs.total("jobs/1/"), blobs.total("jobs/3/")) == (4, 0)


def test_deleting_a_prefix_spares_its_neighbours(blobs: BlobStore) -> None:
    for key in ("jobs/1/result.json", "jobs/12/result.json", "jobs/2/a", "jobs/2/ab"):
        blobs.write_bytes(key, b"{}")
    for prefix in ("jobs/1", "jobs/nothing/", "jobs/2/a"):
        blobs.delete_prefix(prefix)
    assert blobs.keys("jobs/") == ["jobs/12/result.json", "jobs/2/ab"]


def test_a_missing_blob_is_not_found(blobs: BlobStore) -> None:
    for ask in (blobs.local_path, blobs.size):
        with pytest.raises(FileNotFoundError):
            ask("files/none")


def test_a_finished_file_is_moved_into_the_store(blobs: BlobStore) -> None:
    path = blobs.scratch() / "made"
    path.write_bytes(b"made")
    blobs.put_file("features/made.npz", path)
    assert (blobs.local_path("features/made.npz").read_bytes(), path.exists()) == (b"made", False)


def test_a_copy_leaves_the_file_where_it_is(blobs: BlobStore) -> None:
    path = blobs.scratch() / "made"
    path.write_bytes(b"made")
    blobs.put_copy("incoming/made", path)
    assert (blobs.local_path("incoming/made").read_bytes(), path.read_bytes()) == (b"made", b"made")


def test_a_moved_blob_takes_the_place_of_another(blobs: BlobStore) -> None:
    blobs.write_bytes("files/a", b"old")
    blobs.write_bytes("incoming/b", b"new")
    blobs.move("incoming/b", "files/a")
    assert (blobs.local_path("files/a").read_bytes(), blobs.keys("")) == (b"new", ["files/a"])


def test_a_missing_blob_cannot_be_moved(blobs: BlobStore) -> None:
    with pytest.raises(FileNotFoundError):
        blobs.move("incoming/none", "files/a")


def test_blobs_are_listed_by_age(blobs: BlobStore) -> None:
    blobs.write_bytes("incoming/a", b"1")
    now = datetime.now(UTC)
    assert blobs.unchanged_since("incoming/", now - timedelta(hours=1)) == []
    assert blobs.unchanged_since("incoming/", now + timedelta(hours=1)) == ["incoming/a"]
