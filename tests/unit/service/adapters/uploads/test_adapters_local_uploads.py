"""Resumable uploads on disk: one writer at a time over all processes, and nothing counts that is not there for good."""

import os
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from service.adapters.uploads.local_uploads import LocalUploads
from service.errors import NoSuchUploadError
from service.ports import OpenUpload, PendingUpload

NOW = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
UPLOAD = PendingUpload("u1", "a.e57", 100, "filename YS5lNTc=", NOW)
HOLDER = """
import sys, time
from pathlib import Path
from service.adapters.uploads.local_uploads import LocalUploads
opened = LocalUploads(Path(sys.argv[1])).lock("u1")
opened.write(b"trusted")
if sys.argv[2] == "doubt":
    opened.doubt()
    opened.write(b"doubtful")
print("holds", flush=True)
time.sleep(60)
"""


@pytest.fixture
def uploads(tmp_path: Path) -> LocalUploads:
    store = LocalUploads(tmp_path / "uploads")
    store.create(UPLOAD)
    return store


def opened(uploads: LocalUploads) -> OpenUpload:
    found = uploads.lock("u1")
    assert found is not None
    return found


def killed_holder(directory: Path, manner: str) -> None:
    """Let another process write to the upload and die."""
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(directory), manner], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"holds\n"
        assert LocalUploads(directory).lock("u1") is None
        process.kill()


def test_an_upload_comes_back_as_it_was_entered(uploads: LocalUploads) -> None:
    assert (uploads.find("u1").upload, uploads.find("u1").offset, uploads.ids()) == (UPLOAD, 0, ["u1"])


def test_the_offset_is_the_size_of_the_file_on_disk(uploads: LocalUploads) -> None:
    held = opened(uploads)
    held.write(b"abc")
    assert uploads.find("u1").offset == 3


def test_an_upload_is_open_once(uploads: LocalUploads, tmp_path: Path) -> None:
    held = opened(uploads)
    assert LocalUploads(tmp_path / "uploads").lock("u1") is None
    held.close()
    opened(uploads).close()


@pytest.mark.parametrize("manner", ["trust", "doubt"])
def test_a_killed_process_lets_go_and_leaves_what_was_verified(
    uploads: LocalUploads, tmp_path: Path, manner: str
) -> None:
    killed_holder(tmp_path / "uploads", manner)
    assert uploads.find("u1").offset == len(b"trusted")
    held = opened(uploads)
    assert held.path.read_bytes() == b"trusted"


def test_doubtful_bytes_do_not_count_before_they_are_trusted(uploads: LocalUploads) -> None:
    held = opened(uploads)
    held.doubt()
    held.write(b"abc")
    assert uploads.find("u1").offset == 0
    held.trust()
    assert uploads.find("u1").offset == 3


def test_a_removed_upload_is_unknown_also_to_those_who_were_waiting(uploads: LocalUploads) -> None:
    held = opened(uploads)
    held.remove()
    held.close()
    for act in (uploads.find, uploads.lock):
        with pytest.raises(NoSuchUploadError):
            act("u1")
    assert uploads.ids() == []


@pytest.mark.parametrize("name", ["", "..", "../u1", ".u1", "/etc", "u1/content", "a\x00"])
def test_names_that_could_leave_the_directory_are_unknown(uploads: LocalUploads, name: str) -> None:
    for act in (uploads.find, uploads.lock):
        with pytest.raises(NoSuchUploadError):
            act(name)


def test_whoever_has_the_upload_hears_that_it_is_wanted(uploads: LocalUploads) -> None:
    held = opened(uploads)
    assert not held.asked_for()
    uploads.ask_for("u1")
    assert held.asked_for()
    held.close()
    assert not opened(uploads).asked_for()


def test_the_bytes_of_a_finished_upload_go_and_its_offset_stays(uploads: LocalUploads) -> None:
    held = opened(uploads)
    held.write(b"x" * 100)
    held.save(PendingUpload("u1", "a.e57", 100, "", NOW, finished=True))
    assert not held.path.exists()
    assert (uploads.find("u1").offset, uploads.find("u1").upload.finished) == (100, True)


def test_uploads_promise_bytes_until_they_are_finished_or_refused(uploads: LocalUploads) -> None:
    for upload_id in ("u2", "u3"):
        uploads.create(replace(UPLOAD, id=upload_id))
    refused = uploads.lock("u3")
    assert refused is not None
    refused.save(replace(UPLOAD, id="u3", problem={"title": "no scan"}))
    refused.close()
    assert uploads.promised_bytes() == 2 * UPLOAD.length
    opened(uploads).save(replace(UPLOAD, finished=True))
    assert (uploads.promised_bytes(), uploads.of("others").promised_bytes()) == (UPLOAD.length, 0)


def test_folders_that_a_killed_process_left_half_made_are_removed(uploads: LocalUploads, tmp_path: Path) -> None:
    half_made = tmp_path / "uploads" / ".half"
    half_made.mkdir()
    assert uploads.remove_abandoned(datetime.now(UTC) - timedelta(hours=1)) == 0
    os.utime(half_made, (0, 0))
    assert uploads.remove_abandoned(datetime.now(UTC) - timedelta(hours=1)) == 1
    assert uploads.ids() == ["u1"]
