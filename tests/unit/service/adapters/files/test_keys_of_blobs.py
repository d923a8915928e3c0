"""What a station may be called, its downloads may be called; nothing else becomes a place in the store."""

from pathlib import Path

import pytest
from pydantic import TypeAdapter

from schemas.requests.register_inputs import StationName
from service.adapters.files.local_files import LocalFiles, checked_key
from service.errors import StorageError

NAMES = ["Büro 1", "_", "Raum (2)", "S+1", "塔", "a.b-c", "_img src_x"]


@pytest.mark.parametrize("name", NAMES)
def test_a_download_may_be_called_after_any_station(tmp_path: Path, name: str) -> None:
    assert TypeAdapter(StationName).validate_python(name) == name
    key = f"jobs/1/artifacts/{name}.txt"
    files = LocalFiles(tmp_path)
    files.write_bytes(key, b"1 0 0 0")
    assert files.local_path(key).read_bytes() == b"1 0 0 0"
    assert list(files.keys("jobs/1/artifacts/")) == [key]


@pytest.mark.parametrize(
    "key",
    ["", "/etc/passwd", "a/../b", "..", ".hidden", "a/.hidden", "a//b", "a\\b", "a\0b", "a\nb", "a:b", "~", " a", "<"],
)
def test_what_could_leave_the_store_is_no_key(key: str) -> None:
    with pytest.raises(StorageError):
        checked_key(key)
