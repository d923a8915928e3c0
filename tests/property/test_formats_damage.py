"""Truncated and mutated files: a scan or a refusal, never another exception."""

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from service.errors import FileTooLargeError, UnreadableFileError
from service.formats import ReadLimits, inspect_upload
from service.formats.writers import write_scans
from tests.scenes.hostile.hostile_mutations import damaged
from tests.scenes.hostile.hostile_seeds import (
    COLUMNS,
    COUNT,
    MADE_HERE,
    MESH_WRITERS,
    some_scan,
    whole_files,
    write_las,
    write_pcd,
)

LIMITS = ReadLimits(max_points=100_000)
TRIES = 40
DAMAGED_MESHES = int(os.environ.get("TIELINE_FUZZ", "240"))
"""Each has its number for a seed."""


def write_csv(path: Path) -> None:
    lines = [",".join(f"{number:.3f}" for number in point) for point in some_scan().points]
    path.write_text("x,y,z\n" + "\n".join(lines) + "\n")


def write_ascii_ply(path: Path) -> None:
    header = f"ply\nformat ascii 1.0\nelement vertex {COUNT}\nproperty double x\nproperty double y\nproperty double z\n"
    lines = [" ".join(f"{number:.3f}" for number in point) for point in some_scan().points]
    path.write_text(header + "end_header\n" + "\n".join(lines) + "\n")


WRITERS: dict[str, Callable[[Path], None]] = {
    "a.e57": lambda path: write_scans(path, [some_scan(), some_scan()]),
    "a.ply": lambda path: write_scans(path, [some_scan()]),
    "ascii.ply": write_ascii_ply,
    "a.ptx": lambda path: write_scans(path, [some_scan(), some_scan()]),
    "a.las": lambda path: write_las(path, 3),
    # layers, of formats 6 and later, are damaged in test_formats_hostile
    "a.laz": lambda path: write_las(path, 3),
    "a.pcd": lambda path: write_pcd(path, "binary"),
    "ascii.pcd": lambda path: write_pcd(path, "ascii"),
    "compressed.pcd": lambda path: write_pcd(path, "binary_compressed"),
    "a.csv": write_csv,
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("whole")
    for filename, write in WRITERS.items():
        write(folder / filename)
    return {filename: (folder / filename).read_bytes() for filename in WRITERS}


def outcome(path: Path, filename: str, content: bytes) -> str:
    path.write_bytes(content)
    try:
        inspect_upload(path, filename, LIMITS)
    except UnreadableFileError as error:
        return "refused" if error.filename == filename and error.reason and error.place else "refused without words"
    except FileTooLargeError:
        return "refused"
    return "read"


@pytest.mark.parametrize("filename", WRITERS)
def test_the_undamaged_file_is_read(filename: str, whole: dict[str, bytes], tmp_path: Path) -> None:
    assert outcome(tmp_path / "stored", filename, whole[filename]) == "read"


@pytest.mark.parametrize("filename", WRITERS)
def test_a_truncated_file_is_read_or_refused(filename: str, whole: dict[str, bytes], tmp_path: Path) -> None:
    rng = np.random.default_rng(30)
    content = whole[filename]
    lengths = rng.integers(0, len(content), TRIES)
    assert {outcome(tmp_path / "stored", filename, content[:length]) for length in lengths} <= {"read", "refused"}


@pytest.mark.parametrize("filename", ["a.e57", "a.ply", "a.pcd", "compressed.pcd", "a.las", "a.laz"])
def test_a_truncated_binary_file_is_never_taken_for_whole(
    filename: str, whole: dict[str, bytes], tmp_path: Path
) -> None:
    rng = np.random.default_rng(31)
    content = whole[filename]
    assert {outcome(tmp_path / "stored", filename, content[:n]) for n in rng.integers(0, len(content), TRIES)} == {
        "refused"
    }


@pytest.mark.parametrize("filename", WRITERS)
@pytest.mark.parametrize("reach", [None, 500])
def test_a_mutated_file_is_read_or_refused(
    filename: str, reach: int | None, whole: dict[str, bytes], tmp_path: Path
) -> None:
    rng = np.random.default_rng(32)
    outcomes = set()
    for _ in range(TRIES):
        content = bytearray(whole[filename])
        for _ in range(rng.integers(1, 6)):
            content[rng.integers(0, min(len(content), reach or len(content)))] = rng.integers(0, 256)
        outcomes.add(outcome(tmp_path / "stored", filename, bytes(content)))
    assert outcomes <= {"read", "refused"}


def test_a_damaged_mesh_is_read_or_refused(tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    meshes = whole_files(tmp_path / "whole", {**MESH_WRITERS, **MADE_HERE})
    damage = [damaged(meshes, number) for number in range(DAMAGED_MESHES)]
    outcomes = Counter(outcome(tmp_path / "stored", name, content) for name, content in damage)
    assert set(outcomes) == {"read", "refused"}
    assert min(outcomes.values()) > DAMAGED_MESHES // 20


@pytest.mark.parametrize("digits", [b"9" * 6, b"9" * 12, b"9" * 30, b"-1", b"1e9", b"nan", b""])
@pytest.mark.parametrize("filename", [name for name in WRITERS if name not in {"a.e57", "a.las", "a.laz", "a.csv"}])
def test_an_absurd_count_is_refused(filename: str, digits: bytes, whole: dict[str, bytes], tmp_path: Path) -> None:
    count = str(COLUMNS if filename == "a.ptx" else COUNT).encode()
    content = whole[filename].replace(count, digits, 1)
    assert outcome(tmp_path / "stored", filename, content) == "refused"
