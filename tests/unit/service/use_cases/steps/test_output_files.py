"""Files that steps write for their job appear whole or not at all."""

import errno
from pathlib import Path

import pytest

from algorithms.progress import NoProgress
from service.adapters.files.local_files import LocalFiles
from service.errors import InsufficientStorageError
from service.ports import StepContext
from service.use_cases.steps.output_files import artifact, output_file


@pytest.fixture
def context(tmp_path: Path) -> StepContext:
    return StepContext(LocalFiles(tmp_path), NoProgress(), {"min_free_bytes": 0})


def files_in(folder: Path) -> list[str]:
    return [str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()]


def test_a_file_becomes_a_download_of_its_job(context: StepContext) -> None:
    with output_file(context, "j1", "S1.laz") as path:
        path.write_bytes(b"points")
    assert context.blobs.local_path("jobs/j1/artifacts/S1.laz").read_bytes() == b"points"
    described = artifact(context, "j1", "S1.laz", "application/vnd.laszip")
    assert (described.bytes, described.href) == (6, "/jobs/j1/artifacts/S1.laz")


def test_a_step_that_is_computed_once_more_replaces_what_it_had_written(context: StepContext) -> None:
    for content in (b"first", b"again"):
        with output_file(context, "j1", "a.txt") as path:
            path.write_bytes(content)
    assert context.blobs.local_path("jobs/j1/artifacts/a.txt").read_bytes() == b"again"


@pytest.mark.parametrize(
    ("breaks", "becomes"),
    [(ValueError("half"), ValueError), (OSError(errno.ENOSPC, "No space left on device"), InsufficientStorageError)],
)
def test_nothing_is_left_of_a_file_that_breaks_off_and_a_full_disk_is_said_so(
    context: StepContext, tmp_path: Path, breaks: Exception, becomes: type[Exception]
) -> None:
    def write() -> None:
        with output_file(context, "j1", "a.txt") as path:
            path.write_bytes(b"half")
            raise breaks

    with pytest.raises(becomes):
        write()
    assert files_in(tmp_path) == []


def test_a_file_that_will_not_fit_is_not_begun(context: StepContext) -> None:
    with pytest.raises(InsufficientStorageError), output_file(context, "j1", "a.txt", coming_bytes=10**18):
        pytest.fail("the disk has no room for it")
