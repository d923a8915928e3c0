"""Let a process die at each of its dealings with the disk while files come and go, and look whether all mends itself.

Run as ``python -m tests.integration.crash_points DIRECTORY``; prints one JSON line: how many points were tried, and
what was wrong after which.
"""

import asyncio
import hashlib
import json
import os
import shutil
import sys
import traceback
from collections.abc import AsyncIterator, Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from service.adapters.database.files import DatabaseFileStore
from service.adapters.database.jobs import migrate
from service.adapters.database.tables import connect
from service.adapters.files.local_files import LocalFiles
from service.adapters.uploads.local_uploads import LocalUploads
from service.names.content_keys import content_key
from service.settings import Settings
from service.use_cases.limits.quotas import Belongings
from service.use_cases.uploads.clean_up import Cleaner
from service.use_cases.uploads.receive_uploads import Checksum, UploadDesk, UploadPart
from service.use_cases.uploads.store_files import FileIntake, Upload, delete_file
from tests.doubles.memory import MemoryJobStore

DEALINGS = ("write", "fsync", "rename", "replace", "unlink", "link", "mkdir", "rmdir", "truncate", "open")
CONTENT, OTHER = b"1 2 3\n" * 50, b"4 5 6\n" * 50
DIED = 9


class Readers:
    """Take everything for a scan."""

    async def run(
        self,
        step: str,  # noqa: ARG002 - the port's signature
        arguments: dict[str, Any],  # noqa: ARG002
        *,
        timeout_s: float,  # noqa: ARG002
        on_progress: Callable[[float, str], None] | None = None,  # noqa: ARG002
    ) -> dict[str, Any]:
        return {"format": "XYZ", "kind": "scan", "scans": [], "photos": []}


class Service:
    """What one process has in hand."""

    def __init__(self, directory: Path) -> None:
        settings = Settings(data_dir=directory, min_free_bytes=0)
        self.engine = connect(settings)
        self.files = DatabaseFileStore(self.engine)
        self.blobs = LocalFiles(directory)
        self.uploads = LocalUploads(directory / "uploads")
        self.intake = FileIntake(
            Belongings(self.files, MemoryJobStore(), self.uploads), self.blobs, Readers(), settings
        )
        self.desk = UploadDesk(self.uploads, self.intake)

    async def store(self, content: bytes) -> str:
        async def uploads() -> AsyncIterator[Upload]:
            yield Upload("a.xyz", chunks(content))

        return (await self.intake.store(uploads(), datetime.now(UTC)))[0].id

    async def upload(self, content: bytes) -> str:
        """Send a file in two parts, the second with its checksum; go on where an earlier process was interrupted."""
        begun = self.uploads.ids()
        now = datetime.now(UTC)
        upload_id = begun[0] if begun else (await self.desk.begin("a.xyz", len(content), "", now)).upload.id
        offset = (await self.desk.look(upload_id, now)).offset
        if offset < 100:
            offset = (await self.desk.append(upload_id, UploadPart(offset, chunks(content[offset:100])), now)).offset
        if offset < len(content):
            digest = Checksum("sha256", hashlib.sha256(content[offset:]).digest())
            await self.desk.append(upload_id, UploadPart(offset, chunks(content[offset:]), None, digest), now)
        return upload_id

    def delete(self, file_id: str) -> None:
        if self.files.get(file_id) is not None:
            delete_file(file_id, self.files, MemoryJobStore(), self.blobs)


async def chunks(content: bytes) -> AsyncIterator[bytes]:
    yield content[:37]
    yield content[37:]


def scene(directory: Path) -> None:
    """Upload what is stored already, remove the first of the twins, store something else and remove it."""
    service = Service(directory)
    asyncio.run(service.upload(CONTENT))
    service.delete(first_file(service))
    service.delete(asyncio.run(service.store(OTHER)))


def first_file(service: Service) -> str:
    return service.files.find(10, 0)[0][-1].id


def faults_after(directory: Path, first: str) -> Sequence[str]:
    """Go on as client and service do after a crash; give what is wrong in the end."""
    service = Service(directory)
    asyncio.run(service.upload(CONTENT))
    asyncio.run(Cleaner(service.desk, MemoryJobStore()).clean_up(datetime.now(UTC)))
    service.delete(first)
    for file in service.files.find(10, 0)[0]:
        if file.sha256 == hashlib.sha256(OTHER).hexdigest():  # stored, and its client was never told
            service.delete(file.id)
    asyncio.run(Cleaner(service.desk, MemoryJobStore()).clean_up(datetime.now(UTC) + timedelta(hours=25)))
    files, number = service.files.find(10, 0)
    sha256 = hashlib.sha256(CONTENT).hexdigest()
    found = []
    if [file.sha256 for file in files] != [sha256]:
        found.append(f"{number} files")
    elif service.blobs.local_path(content_key(sha256)).read_bytes() != CONTENT:
        found.append("another content")
    stored = {path.relative_to(directory).as_posix() for path in directory.rglob("*") if path.is_file()}
    strays = {name for name in stored if not name.startswith("tieline.sqlite")} - {f"blobs/{content_key(sha256)}"}
    return [*found, *sorted(strays)]


def die_at(number: int) -> Callable[[], int]:
    """Count dealings with the disk and die at one of them; give the function that tells the count."""
    count = 0

    def deal() -> None:
        nonlocal count
        count += 1
        if count == number:
            os._exit(DIED)

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            deal()
            return function(*arguments, **options)

        return call

    for name in DEALINGS:
        setattr(os, name, watched(getattr(os, name)))
    for event in ("commit", "rollback", "begin"):
        sa.event.listen(sa.Engine, event, lambda _connection: deal())
    return lambda: count


def in_child(work: Callable[[], object]) -> tuple[int, str]:
    """Do something in a copy of this process; give its exit code and what it said."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            os.close(reading)
            said = str(work())
            with os.fdopen(writing, "w") as pipe:
                pipe.write(said)
            os._exit(0)
        except BaseException:  # noqa: BLE001 - a child must not go on as its parent
            traceback.print_exc()
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        said = pipe.read()
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), said


def main(directory: Path) -> None:
    prepared = directory / "prepared"
    migrate(Settings(data_dir=prepared))
    code, first = in_child(lambda: asyncio.run(Service(prepared).store(CONTENT)))
    wrong: dict[int, Sequence[str]] = {}
    number = 0
    while code in {0, DIED}:
        number += 1
        place = directory / "crashed"
        shutil.copytree(prepared, place)

        def crash(place: Path = place, number: int = number) -> None:
            die_at(number)
            scene(place)

        code, _ = in_child(crash)
        mended, said = in_child(lambda place=place: json.dumps(faults_after(place, first)))  # type: ignore[misc]
        faults = json.loads(said) if mended == 0 else ["it could not go on"]
        if faults:
            wrong[number] = faults
        shutil.rmtree(place)
        if code == 0:
            break
    print(json.dumps({"points": number - 1, "ended": code, "wrong": wrong}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
