"""A computation sees its files and the libraries, and nothing and nobody else; it makes what is its own."""

import asyncio
import os
import socket
from pathlib import Path
from typing import Any

import psutil
import pytest

from service.adapters.files.object_files import blob_store
from service.adapters.processes.child_process import ChildProcesses
from service.adapters.processes.confinement import available
from service.adapters.processes.own_user import FIRST_USER, MOST_THREADS
from service.adapters.processes.process_limits import DEFAULT_STEPS
from service.names.content_keys import incoming_key
from service.ports import StepFailedError
from service.settings import Settings
from tests.measures.patience import patience
from tests.scenes.hostile.confined_steps import SECRETS
from tests.unit.service.formats.test_formats_units import COMPOUND, POINTS, las

STEPS = "tests.scenes.hostile.confined_steps:STEPS"
IDENTIFIER = "0123456789abcdef0123456789abcdef"
OWN = {"inspect-file": incoming_key(IDENTIFIER), "echo": f"features/{'a' * 64}/{'b' * 64}.npz"}
REFUSED = {"EACCES", "EPERM", "EXDEV"}
"""EXDEV: as if another folder were another disk."""
WAYS = {
    "an inspection, copied from a nursery": ("inspect-file", True),
    "an inspection in a process of its own": ("inspect-file", False),
    "a step of a job, copied from a nursery": ("echo", True),
    "a step of a job in a process of its own": ("echo", False),
}


def needs_a_kernel() -> None:
    if not (available().landlock and available().seccomp):
        pytest.skip("this kernel has not both Landlock and seccomp")


@pytest.fixture(scope="module", params=WAYS.values(), ids=WAYS.keys())
def tried(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    needs_a_kernel()
    step, nursery = request.param
    data = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as patch:
        for name in SECRETS:
            patch.setenv(name, "a secret of sixteen bytes")
        settings = Settings(
            data_dir=data,
            nursery=nursery,
            database_url="postgresql://tieline:a-secret@nowhere/x",
            callback_secret="a-secret-of-callbacks",  # noqa: S106
            storage_url=f"file://{data}" if nursery else "",
        )
        return asyncio.run(_tried(settings, step))


async def _tried(settings: Settings, step: str) -> dict[str, Any]:
    blobs = settings.data_dir / "blobs"
    mine = blobs / OWN[step]
    others = {
        "a file of another project": blobs / "files" / ("c" * 64),
        "features of another project": blobs / "features" / ("a" * 64) / f"{'d' * 64}.npz",
        "another one that comes": blobs / incoming_key("f" * 32),
        "the database": settings.data_dir / "tieline.sqlite",
        "a result of another job": blobs / "jobs" / "another" / "result.json",
    }
    for path in (mine, *others.values()):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"content")
    arguments = {
        "key": OWN[step],
        "filename": "a.e57",
        "bytes": 7,
        "job_id": "mine",
        # as what a client says, which names nothing
        "inputs": {"sha256": "c" * 64, "features": f"features/{'a' * 64}/{'d' * 64}.npz"},
        "others": {**{name: str(path) for name, path in others.items()}, "passwords": "/etc/passwd"},
    }
    found = await _run(settings, step, arguments)
    assert mine.read_bytes() == b"content"
    return found


async def _run(settings: Settings, step: str, arguments: dict[str, Any]) -> dict[str, Any]:
    runner = ChildProcesses(settings, blob_store, STEPS)
    try:
        return await runner.run(step, arguments, timeout_s=120.0 * patience())
    finally:
        runner.close()


def test_it_reads_its_file_and_writes_to_its_scratch_directory(tried: dict[str, Any]) -> None:
    assert tried["found"]["read the file"] == "done: b'content'"
    assert tried["scratch"] == "1"


def test_whatever_else_it_tries_is_refused(tried: dict[str, Any]) -> None:
    rest = {name: what for name, what in tried["found"].items() if name != "read the file"}
    assert len(rest) > 35
    assert {name: what for name, what in rest.items() if what not in REFUSED} == {}


def test_it_finds_no_secrets(tried: dict[str, Any]) -> None:
    assert tried["environment"] == {}
    assert [entry for entry in tried["started with"] if "secret" in entry] == []
    assert tried["settings"] == ["", "", ""]


def test_where_the_service_is_root_it_is_a_user_of_its_own_without_privileges(tried: dict[str, Any]) -> None:
    if os.geteuid() != 0:
        pytest.skip("the service does not run as root here")
    assert min(tried["users"]) > FIRST_USER
    assert int(tried["capabilities"], 16) == 0
    assert tried["threads"] == MOST_THREADS


def test_it_gets_no_more_rights_and_goes_first_when_memory_ends(tried: dict[str, Any]) -> None:
    assert (tried["privileges"], tried["goes first"]) == (1, "900")


@pytest.mark.parametrize(
    ("kind", "key"),
    [
        ("blob", "jobs/another/result.json"),
        ("blob", f"features/{'a' * 64}/{'b' * 64}.npz"),
        ("blob", "incoming/other"),
        ("link", "jobs/mine/result.json"),
        ("pipe", "jobs/mine/result.json"),
    ],
)
def test_what_it_makes_that_is_not_its_own_or_no_file_does_not_come_into_the_store(
    tmp_path: Path, kind: str, key: str
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("of another project")
    arguments = {"job_id": "mine", "kind": kind, "as": key, "to": str(secret)}
    with pytest.raises(StepFailedError, match="which is not its own"):
        # confined, it could make no link and no pipe
        asyncio.run(_run(Settings(data_dir=tmp_path, nursery=False, confine_children=False), "make", arguments))
    assert not (tmp_path / "blobs" / key).exists()


def test_what_it_makes_of_its_own_comes_into_the_store(tmp_path: Path) -> None:
    arguments = {"job_id": "mine", "kind": "blob", "as": "jobs/mine/artifacts/a.csv"}
    asyncio.run(_run(Settings(data_dir=tmp_path, nursery=False), "make", arguments))
    assert (tmp_path / "blobs" / "jobs" / "mine" / "artifacts" / "a.csv").read_bytes() == b"made"
    assert list((tmp_path / "scratch").iterdir()) == []


def test_what_fetches_a_file_reaches_servers_and_nothing_of_the_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs_a_kernel()
    for name in SECRETS:
        monkeypatch.setenv(name, "a secret of sixteen bytes")
    other = tmp_path / "other"
    other.write_bytes(b"content")
    settings = Settings(data_dir=tmp_path / "data", database_url="", storage_url="", callback_secret="")
    with socket.create_server(("127.0.0.1", 0)) as server:
        arguments = {"id": IDENTIFIER, "href": str(other), "max_bytes": server.getsockname()[1]}
        found = asyncio.run(_run(settings, "fetch-file", arguments))
    assert found["found"] == {
        "reach a server": "done: None",
        "look a name up": "done: True",
        "read a file of the service": "EACCES",
        "write a file of the service": "EACCES",
        "start a program": "EPERM",
    }
    assert list(found["environment"]) == ["AWS_SECRET_ACCESS_KEY"]
    assert other.read_bytes() == b"content"


@pytest.mark.parametrize("nursery", [True, False])
def test_nothing_that_it_starts_outlives_it(tmp_path: Path, nursery: bool) -> None:
    # confined, it could start nothing
    settings = Settings(data_dir=tmp_path, nursery=nursery, confine_children=False)
    asyncio.run(_run(settings, "stay", {"job_id": "mine"}))
    group = int((tmp_path / "blobs" / "jobs" / "mine" / "result.json").read_text())
    left = [process for process in psutil.process_iter() if _group_of(process.pid) == group]
    gone, alive = psutil.wait_procs(left, 10.0)
    assert [process for process in alive if process.status() != psutil.STATUS_ZOMBIE] == [], gone


def _group_of(process: int) -> int | None:
    try:
        return os.getpgid(process)
    except ProcessLookupError:
        return None


def test_what_is_on_is_said() -> None:
    assert "Landlock" in available().text


def test_the_unit_of_a_reference_system_is_found_by_a_reader_that_sees_its_file_only(tmp_path: Path) -> None:
    key = incoming_key(IDENTIFIER)
    (tmp_path / "blobs" / key).parent.mkdir(parents=True)
    written = las(tmp_path / "a.las", POINTS, COMPOUND).rename(tmp_path / "blobs" / key)
    runner = ChildProcesses(Settings(data_dir=tmp_path), blob_store, DEFAULT_STEPS)
    arguments = {"key": key, "filename": "a.las", "bytes": written.stat().st_size, "columns": ""}
    try:
        found = asyncio.run(runner.run("inspect-file", arguments, timeout_s=120.0 * patience()))
    finally:
        runner.close()
    assert found["scans"][0]["unit"] == "us-ft, height m"
