"""What clients and killed processes have left half-done is finished or removed, and nothing else is touched."""

import asyncio
import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from service.adapters.files.local_files import LocalFiles
from service.adapters.uploads.local_uploads import LocalUploads
from service.names.content_keys import content_key
from service.ports import Job, JobStatus, PendingUpload, StoredFile
from service.settings import Settings
from service.use_cases.limits.quotas import Belongings
from service.use_cases.uploads.adopt_files import adopt_files
from service.use_cases.uploads.clean_up import Cleaner, CleanUp
from service.use_cases.uploads.receive_uploads import UploadDesk
from service.use_cases.uploads.store_files import FileIntake
from tests.doubles.memory import MemoryFileStore, MemoryJobStore

NOW = datetime.now(UTC)
CONTENT, OTHER = "a" * 64, "b" * 64


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


class House:
    """A data directory and what looks after it."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        # what expires counts from when its file was written: this module may have been loaded an hour before
        self.opened = datetime.now(UTC)
        self.blobs = LocalFiles(directory)
        self.files = MemoryFileStore()
        self.jobs = MemoryJobStore()
        self.uploads = LocalUploads(directory / "uploads")
        settings = Settings(data_dir=directory, min_free_bytes=0)
        belongings = Belongings(self.files, self.jobs, self.uploads)
        self.desk = UploadDesk(self.uploads, FileIntake(belongings, self.blobs, Readers(), settings))

    def enter(self, file_id: str, sha256: str) -> None:
        self.files.add(StoredFile(file_id, "a.xyz", 1, sha256, "XYZ", "scan", NOW))

    def clean_up(self, after: timedelta = timedelta(0)) -> CleanUp:
        return asyncio.run(Cleaner(self.desk, self.jobs).clean_up(self.opened + after))

    def left(self) -> list[str]:
        paths = (path for path in self.directory.rglob("*") if path.is_file())
        return sorted(path.relative_to(self.directory).as_posix() for path in paths)


@pytest.fixture
def house(tmp_path: Path) -> House:
    return House(tmp_path)


def test_where_all_is_in_order_nothing_happens(house: House) -> None:
    house.enter("f1", CONTENT)
    house.enter("f2", CONTENT)
    for key in (content_key(CONTENT), f"features/{CONTENT}/x.npz", "jobs/j1/result.json"):
        house.blobs.write_bytes(key, b"1")
    house.jobs.create_and_enqueue(Job("j1", "echo", {}, JobStatus.ACCEPTED, NOW))
    before = house.left()
    assert house.clean_up(after=timedelta(days=30)).nothing
    assert house.left() == before


def test_content_and_features_without_a_file_are_removed(house: House) -> None:
    house.enter("f1", CONTENT)
    for key in (content_key(CONTENT), content_key(OTHER), f"features/{OTHER}/x.npz"):
        house.blobs.write_bytes(key, b"1")
    assert house.clean_up() == CleanUp(contents_removed=1)
    assert house.blobs.keys("") == [content_key(CONTENT)]


def test_files_without_content_are_forgotten(house: House) -> None:
    house.enter("f1", CONTENT)
    house.enter("f2", OTHER)
    house.blobs.write_bytes(content_key(CONTENT), b"1")
    assert house.clean_up() == CleanUp(files_forgotten=1)
    assert house.files.find(10, 0)[1] == 1


def test_an_empty_storage_or_database_is_taken_for_the_wrong_one(house: House, tmp_path: Path) -> None:
    house.enter("f1", CONTENT)
    assert house.clean_up().nothing
    stranger = House(tmp_path / "other")
    stranger.blobs.write_bytes(content_key(CONTENT), b"1")
    stranger.blobs.write_bytes("jobs/j1/result.json", b"1")
    assert stranger.clean_up(after=timedelta(days=30)).nothing


def test_files_that_arrived_and_were_never_entered_go_after_a_while(house: House) -> None:
    house.blobs.write_bytes("incoming/f1", b"1")
    house.blobs.write_bytes("probes/1", b"1")
    (house.directory / "scratch" / "partial-1").write_bytes(b"1")
    assert house.clean_up().nothing
    assert house.clean_up(after=timedelta(days=2)) == CleanUp(half_made=3)
    assert house.left() == []


def test_results_of_unknown_jobs_go_after_a_while(house: House) -> None:
    house.jobs.create_and_enqueue(Job("j1", "echo", {}, JobStatus.ACCEPTED, NOW))
    for job_id in ("j1", "j2"):
        house.blobs.write_bytes(f"jobs/{job_id}/result.json", b"1")
    assert house.clean_up().nothing
    assert house.clean_up(after=timedelta(days=2)) == CleanUp(jobs_removed=1)
    assert house.blobs.keys("") == ["jobs/j1/result.json"]


def test_what_a_job_has_stored_that_was_dismissed_is_counted_when_its_computations_have_stopped(house: House) -> None:
    house.jobs.create_and_enqueue(Job("j1", "echo", {}, JobStatus.ACCEPTED, NOW))
    house.blobs.write_bytes("jobs/j1/artifacts/pair.json", b"123")
    house.jobs.dismiss("j1", house.opened)
    assert house.clean_up(after=timedelta(seconds=30)).nothing
    assert house.clean_up(after=timedelta(minutes=2)) == CleanUp(jobs_counted=1)
    assert house.jobs.results_bytes() == 3
    assert house.clean_up(after=timedelta(minutes=2)).nothing


def test_an_unfinished_upload_expires(house: House) -> None:
    house.uploads.create(PendingUpload("u1", "a.xyz", 100, "", house.opened))
    assert house.clean_up(after=timedelta(hours=23)).nothing
    assert house.clean_up(after=timedelta(hours=25)) == CleanUp(uploads_expired=1)
    assert house.left() == []


def test_an_upload_that_goes_on_does_not_expire(house: House) -> None:
    house.uploads.create(PendingUpload("u1", "a.xyz", 100, "", house.opened))
    os.utime(house.directory / "uploads" / "u1" / "upload.json", (0, 0))
    assert house.clean_up(after=timedelta(hours=23)).nothing


def test_an_upload_that_somebody_writes_to_is_left_alone(house: House) -> None:
    house.uploads.create(PendingUpload("u1", "a.xyz", 100, "", house.opened))
    opened = house.uploads.lock("u1")
    assert opened is not None
    assert house.clean_up(after=timedelta(days=2)).nothing
    opened.close()


def test_a_complete_upload_whose_process_died_becomes_a_file(house: House) -> None:
    house.uploads.create(PendingUpload("u1", "a.xyz", 3, "", NOW))
    opened = house.uploads.lock("u1")
    assert opened is not None
    opened.write(b"123")
    opened.close()
    assert house.clean_up() == CleanUp(uploads_finished=1)
    file = house.files.get("u1")
    assert file is not None
    assert house.blobs.local_path(content_key(file.sha256)).read_bytes() == b"123"
    assert house.left() == [f"blobs/{content_key(file.sha256)}", "uploads/u1/upload.json"]


def test_finishing_an_upload_whose_file_is_entered_already_changes_nothing(house: House) -> None:
    house.uploads.create(PendingUpload("u1", "a.xyz", 3, "", NOW))
    opened = house.uploads.lock("u1")
    assert opened is not None
    opened.write(b"123")
    entered = asyncio.run(house.desk.intake.store_finished("u1", "a.xyz", opened.whole(), NOW))
    opened.close()  # and here the process died
    house.clean_up()
    assert (house.files.find(10, 0), house.uploads.find("u1").upload.finished) == (([entered], 1), True)


def test_blobs_named_by_the_id_of_their_file_are_carried_over(house: House) -> None:
    for file_id, sha256 in (("f1", CONTENT), ("f2", CONTENT), ("f3", OTHER)):
        house.enter(file_id, sha256)
        house.blobs.write_bytes(f"files/{file_id}", sha256.encode())
    assert adopt_files(house.files, house.blobs) == 3
    assert house.blobs.keys("") == [content_key(CONTENT), content_key(OTHER)]
    assert adopt_files(house.files, house.blobs) == 0
