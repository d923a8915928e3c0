"""Room is kept for what comes: several uploads at the same time cannot fill the disk, announced ones keep nothing."""

import asyncio
import os
import shutil
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from service.adapters.files.disk_space import set_aside
from service.adapters.files.local_files import LocalFiles
from service.adapters.uploads.local_uploads import LocalUploads
from service.errors import InsufficientStorageError
from service.settings import Settings
from service.use_cases.limits.quotas import Belongings
from service.use_cases.uploads.receive_uploads import UploadDesk, UploadPart
from service.use_cases.uploads.store_files import FileIntake, Upload
from tests.doubles.memory import MemoryFileStore, MemoryJobStore

MEGABYTE = 1 << 20
LARGE = 600 * MEGABYTE
"""Much more than other programs write to the disk while a test lasts."""
NOW = datetime.now(UTC)


class Readers:
    """Take everything for a scan."""

    async def run(self, *_: Any, **__: Any) -> dict[str, Any]:
        return {"format": "XYZ", "kind": "scan", "scans": [], "photos": []}


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """Skip where room cannot be set aside, or where the disk is nearly full."""
    with (tmp_path / "tried").open("wb") as file:
        if not set_aside(file.fileno(), 1):
            pytest.skip("this file system sets no room aside")
    if shutil.disk_usage(tmp_path).free < 4 * LARGE:
        pytest.skip("the disk is nearly full")
    return tmp_path


def desk(directory: Path, room: float) -> UploadDesk:
    """Give a desk with room for so many large uploads."""
    least = shutil.disk_usage(directory).free - int(room * LARGE)
    settings = Settings(data_dir=directory, min_free_bytes=least)
    uploads = LocalUploads(directory / "uploads")
    belongings = Belongings(MemoryFileStore(), MemoryJobStore(), uploads)
    return UploadDesk(uploads, FileIntake(belongings, LocalFiles(directory), Readers(), settings))


def free(directory: Path) -> int:
    return shutil.disk_usage(directory).free


def begin(at: UploadDesk, length: int = LARGE) -> str:
    return asyncio.run(at.begin("a.xyz", length, "", NOW)).upload.id


def test_room_set_aside_is_no_part_of_the_file_and_comes_back_with_its_end(directory: Path) -> None:
    before, path = free(directory), directory / "file"
    with path.open("wb") as file:
        set_aside(file.fileno(), LARGE)
        assert (os.fstat(file.fileno()).st_size, before - free(directory) > LARGE // 2) == (0, True)
    path.unlink()
    assert before - free(directory) < LARGE // 2


def test_what_is_announced_keeps_no_room_from_others(directory: Path) -> None:
    at, before = desk(directory, 1.5), free(directory)
    for _ in range(3):
        begin(at)
    assert before - free(directory) < LARGE // 2
    assert len(at.uploads.ids()) == 3


def test_more_than_there_is_room_for_cannot_be_announced(directory: Path) -> None:
    with pytest.raises(InsufficientStorageError):
        begin(desk(directory, 0.5))


def test_room_is_set_aside_for_what_comes_and_given_back_when_it_stops(directory: Path) -> None:
    at, before, seen = desk(directory, 1.5), free(directory), []

    async def chunks() -> AsyncIterator[bytes]:
        yield bytes(MEGABYTE)
        seen.append(before - free(directory))

    part = UploadPart(0, chunks(), LARGE)
    assert asyncio.run(at.append(begin(at), part, NOW)).offset == MEGABYTE
    assert 100 * MEGABYTE < seen[0] < 200 * MEGABYTE
    assert before - free(directory) < 50 * MEGABYTE


def test_a_part_that_does_not_fit_is_refused_before_it_comes(directory: Path) -> None:
    at = desk(directory, 1.1)
    upload = begin(at)
    filling = directory / "filling"
    with filling.open("wb") as file:
        set_aside(file.fileno(), LARGE)
        with pytest.raises(InsufficientStorageError):
            asyncio.run(at.append(upload, UploadPart(0, _nothing(), LARGE), NOW))
    assert at.uploads.find(upload).offset == 0


async def _nothing() -> AsyncIterator[bytes]:
    raise AssertionError("the body was asked for")
    yield b""


def test_of_two_bodies_at_once_that_do_not_fit_together_one_is_refused_before_the_disk_is_full(directory: Path) -> None:
    at = desk(directory, 1.5)

    async def body(began: asyncio.Event, other: asyncio.Event) -> AsyncIterator[bytes]:
        began.set()
        await other.wait()
        for _ in range(3):
            yield bytes(70 * MEGABYTE)

    async def store(began: asyncio.Event, other: asyncio.Event) -> Any:
        async def uploads() -> AsyncIterator[Upload]:
            yield Upload("a.xyz", body(began, other), LARGE)

        return await at.intake.store(uploads(), NOW)

    async def both() -> list[Any]:
        began = asyncio.Event(), asyncio.Event()
        return await asyncio.gather(store(*began), store(*began[::-1]), return_exceptions=True)

    ends = asyncio.run(both())
    assert any(isinstance(end, InsufficientStorageError) for end in ends)
    assert list((directory / "scratch").iterdir()) == []


def test_a_file_that_ends_early_keeps_no_more_room_than_it_needs(directory: Path) -> None:
    at, before = desk(directory, 3.0), free(directory)

    async def chunks() -> AsyncIterator[bytes]:
        yield b"1 2 3\n"

    async def uploads() -> AsyncIterator[Upload]:
        yield Upload("a.xyz", chunks(), LARGE)

    asyncio.run(at.intake.store(uploads(), NOW))
    assert before - free(directory) < LARGE // 2
