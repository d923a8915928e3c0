"""What damaged files and bombs have shown, kept: files that declare too much or ask for what lies outside."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from service.errors import UnreadableFileError
from service.formats import ReadLimits, inspect_upload
from tests.scenes.hostile.hostile_bombs import bombs
from tests.scenes.hostile.hostile_mutations import damaged
from tests.scenes.hostile.hostile_seeds import whole_files

LIMITS = ReadLimits(max_points=1_000_000, max_pixels=4_000_000)
FOUND = {
    "PLY of 5000 digits vertices": "no PLY header line",
    "PLY with 2^31 faces before the vertices": "do not fit the file",
    "text of one line of 30 MB": "a line of more than",
    "E57 of a billion laughs": "document type",
    "E57 of a billion laughs in UTF-16": "not XML 1.0 in UTF-8",
    "E57 that reads a file": "document type",
    "E57 with an outside grammar": "document type",
    "E57 with an outside schema": "schema to be fetched",
    "E57 of 30,000 nested elements": "nested more than",
    "E57 of 40,000 elements in one": "more than 1000 members",
    "E57 of a vector of 40,000": "a vector more than 10000",
    "E57 of 40,000 name spaces": "more than 1000 members",
    "E57 whose XML has 2^60 bytes": "does not fit a file",
    "new LAZ of 2^32-1 chunks": "LAZ chunks do not fit",
}
LAYERS_THAT_ABORTED_THE_LIBRARY = (848, 914)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    return whole_files(tmp_path_factory.mktemp("whole"))


def refusal(path: Path, name: str, content: bytes) -> UnreadableFileError:
    path.write_bytes(content)
    with pytest.raises(UnreadableFileError) as refused:
        inspect_upload(path, name, LIMITS)
    assert refused.value.place
    return refused.value


@pytest.mark.parametrize("which", FOUND)
def test_what_was_found_is_refused(whole: Mapping[str, bytes], tmp_path: Path, which: str) -> None:
    name, content = bombs(whole, "http://127.0.0.1:9/")[which]()
    assert FOUND[which] in refusal(tmp_path / "stored", name, content).reason


@pytest.mark.parametrize("number", LAYERS_THAT_ABORTED_THE_LIBRARY)
def test_layers_longer_than_their_chunk_are_refused(whole: Mapping[str, bytes], tmp_path: Path, number: int) -> None:
    name, content = damaged(whole, number)
    assert name == "new.laz"
    assert "layers" in refusal(tmp_path / "stored", name, content).reason


def test_an_image_longer_than_its_file_is_refused_alone(whole: Mapping[str, bytes], tmp_path: Path) -> None:
    name, content = bombs(whole, "")["E57 with an image of 60 MB"]()
    (tmp_path / "stored").write_bytes(content)
    found = inspect_upload(tmp_path / "stored", name, LIMITS)
    assert len(found.scans) == 1
    assert "whole file" in (found.photos[0].refused or "")


@pytest.mark.slow
def test_empty_ptx_scans_cost_little_and_are_counted(whole: Mapping[str, bytes], tmp_path: Path) -> None:
    name, content = bombs(whole, "")["PTX of 20,000 empty scans"]()
    assert "more than 10000 scans" in refusal(tmp_path / "stored", name, content).reason
