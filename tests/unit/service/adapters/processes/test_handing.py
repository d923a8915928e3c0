"""What a process is handed stays what it was, whatever comes to lie under the same name."""

from pathlib import Path

from service.adapters.processes.handing import pinned


def test_what_replaces_a_blob_is_not_what_was_handed(tmp_path: Path) -> None:
    blob, other, directory = tmp_path / "blob", tmp_path / "other", tmp_path / "run"
    directory.mkdir()
    blob.write_bytes(b"content")
    handed = pinned({"files/a": str(blob)}, directory)
    other.write_bytes(b"another")
    other.replace(blob)
    assert Path(handed["files/a"]).read_bytes() == b"content"
    assert Path(handed["files/a"]).is_relative_to(directory)


def test_a_blob_that_can_have_no_second_name_is_handed_itself(tmp_path: Path) -> None:
    (tmp_path / "blob").write_bytes(b"content")
    absent = tmp_path / "no directory"
    assert pinned({"files/a": str(tmp_path / "blob")}, absent) == {"files/a": str(tmp_path / "blob")}
