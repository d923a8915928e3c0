"""Which reader serves a file: content first, and the name must not contradict."""

from pathlib import Path

import pytest

from service.errors import UnreadableFileError
from service.formats import inspect_file, read_scan, reader_for

FOUR = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
HEADS = {
    "E57": b"ASTM-E57\1\0\0\0",
    "PLY": b"ply\nformat ascii 1.0\n",
    "PCD": b"# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\n",
    "LAS": b"LASF\0\0\0\0",
    "PTX": b"2\n3\n0 0 0\n1 0 0\n",
    "XYZ text": FOUR,
}


def stored(tmp_path: Path, content: bytes) -> Path:
    path = tmp_path / "4711"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", HEADS)
def test_a_file_without_extension_is_known_by_its_content(tmp_path: Path, name: str) -> None:
    assert reader_for(stored(tmp_path, HEADS[name]), "upload").name == name


@pytest.mark.parametrize(("name", "filename"), [("E57", "a.E57"), ("LAS", "a.copc.laz"), ("XYZ text", "a.PTS")])
def test_the_extension_may_be_in_capitals_or_double(tmp_path: Path, name: str, filename: str) -> None:
    assert reader_for(stored(tmp_path, HEADS[name]), filename).name == name


def test_a_signature_is_enough_under_an_unknown_name(tmp_path: Path) -> None:
    assert reader_for(stored(tmp_path, HEADS["E57"]), "setup.001").name == "E57"


@pytest.mark.parametrize(
    ("content", "filename", "reason"),
    [
        (b"", "a.e57", "empty"),
        (b"\xff\xd8\xff\xe0rest", "a.e57", "not E57; it looks like a JPEG image"),
        (HEADS["LAS"], "a.e57", "not E57; it looks like LAS"),
        (HEADS["PTX"], "a.pts", "not XYZ text; it looks like PTX"),
        (FOUR, "a.ptx", "not PTX; it looks like XYZ text"),
        (b"hello world", "a.txt", "not XYZ text; it looks like no format known here"),
        (b"\0" * 5000, "a.xyz", "not XYZ text"),
        (FOUR, "a.3d", r"\*\.3d are not supported"),
        (b"whatever", "noext", "the format is not supported"),
    ],
)
def test_a_contradiction_is_refused_with_the_reason(tmp_path: Path, content: bytes, filename: str, reason: str) -> None:
    with pytest.raises(UnreadableFileError, match=reason):
        inspect_file(stored(tmp_path, content), filename)


@pytest.mark.parametrize("index", [1, -1, 99])
def test_a_scan_that_is_not_there_is_named(tmp_path: Path, index: int) -> None:
    with pytest.raises(UnreadableFileError, match=f"scan {index}"):
        read_scan(stored(tmp_path, FOUR), "a.xyz", index)
