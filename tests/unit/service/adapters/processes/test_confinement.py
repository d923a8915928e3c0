"""A process that reads an uploaded file sees it and the libraries, and nothing and nobody else."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from service.adapters.processes.child_process import ChildProcesses
from service.adapters.processes.confinement import available
from service.adapters.processes.process_limits import DEFAULT_STEPS
from service.names.content_keys import incoming_key
from service.settings import Settings
from tests.scenes.hostile.confined_steps import SECRETS
from tests.unit.service.formats.test_formats_units import COMPOUND, POINTS, las

STEPS = "tests.scenes.hostile.confined_steps:STEPS"
IDENTIFIER = "0123456789abcdef0123456789abcdef"


@pytest.fixture(scope="module", params=[True, False], ids=["a copy of a nursery", "a process of its own"])
def tried(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    if not (available().landlock and available().seccomp):
        pytest.skip("this kernel has not both Landlock and seccomp")
    data = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as patch:
        for name in SECRETS:
            patch.setenv(name, "a secret")
        settings = Settings(
            data_dir=data,
            nursery=request.param,
            database_url="postgresql://tieline:a-secret@nowhere/x",
            callback_secret="a-secret-of-callbacks",  # noqa: S106
            storage_url=f"file://{data}/blobs" if request.param else "",
        )
        return asyncio.run(_tried(settings))


async def _tried(settings: Settings) -> dict[str, Any]:
    key = incoming_key(IDENTIFIER)
    mine = settings.data_dir / "blobs" / key
    others = {
        "a file of another project": settings.data_dir / "blobs" / "files" / "ab" / "content",
        "another one that comes": settings.data_dir / "blobs" / incoming_key("f" * 32),
        "the database": settings.data_dir / "tieline.sqlite",
        "its own project": settings.data_dir / "blobs" / "jobs" / "x" / "result.json",
    }
    for path in (mine, *others.values()):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"content")
    runner = ChildProcesses(settings, STEPS, reads_only=True)
    try:
        arguments = {
            "key": key,
            "filename": "a.e57",
            "bytes": 7,
            "others": {**{name: str(path) for name, path in others.items()}, "passwords": "/etc/passwd"},
        }
        found = await runner.run("inspect-file", arguments, timeout_s=120.0)
    finally:
        runner.close()
    assert mine.read_bytes() == b"content"
    return found


def test_it_reads_its_file_and_writes_to_its_scratch_directory(tried: dict[str, Any]) -> None:
    assert tried["found"]["read the file"] == "done: b'content'"
    assert tried["scratch"] == "1"


def test_whatever_else_it_tries_is_refused(tried: dict[str, Any]) -> None:
    rest = {name: what for name, what in tried["found"].items() if name != "read the file"}
    assert len(rest) > 10
    assert {name: what for name, what in rest.items() if what != "PermissionError"} == {}


def test_it_finds_no_secrets(tried: dict[str, Any]) -> None:
    assert tried["environment"] == {}
    assert [entry for entry in tried["started with"] if "secret" in entry] == []


def test_it_gets_no_more_rights_and_goes_first_when_memory_ends(tried: dict[str, Any]) -> None:
    assert (tried["privileges"], tried["goes first"]) == (1, "900")


@pytest.mark.parametrize(("storage", "known"), [("", []), ("s3://bucket", ["AWS_SECRET_ACCESS_KEY"])])
def test_a_computation_knows_credentials_only_of_the_object_store_that_it_uses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: str, known: list[str]
) -> None:
    for name in SECRETS:
        monkeypatch.setenv(name, "a secret of sixteen bytes")
    made = ChildProcesses(Settings(data_dir=tmp_path, database_url="", storage_url=storage))
    assert [name for name in SECRETS if name in made._environment()] == known


def test_what_is_on_is_said() -> None:
    assert "Landlock" in available().text


def test_the_unit_of_a_reference_system_is_found_by_a_reader_that_sees_its_file_only(tmp_path: Path) -> None:
    key = incoming_key(IDENTIFIER)
    (tmp_path / "blobs" / key).parent.mkdir(parents=True)
    written = las(tmp_path / "a.las", POINTS, COMPOUND).rename(tmp_path / "blobs" / key)
    runner = ChildProcesses(Settings(data_dir=tmp_path), DEFAULT_STEPS, reads_only=True)
    arguments = {"key": key, "filename": "a.las", "bytes": written.stat().st_size, "columns": ""}
    try:
        found = asyncio.run(runner.run("inspect-file", arguments, timeout_s=120.0))
    finally:
        runner.close()
    assert found["scans"][0]["unit"] == "us-ft, height m"
