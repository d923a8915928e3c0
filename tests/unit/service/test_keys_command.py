"""`tieline keys`, on a data directory of its own."""

from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from service.__main__ import app
from service.adapters.database.keys import DatabaseKeyStore
from service.adapters.database.tables import connect
from service.keys_command import opened_keys
from service.ports import Key, Scope
from service.settings import Settings
from service.use_cases.access.key_secrets import matches


@pytest.fixture(autouse=True)
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TIELINE_DATA_DIR", str(tmp_path))
    return tmp_path


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["keys", *arguments])


def kept() -> list[Key]:
    with opened_keys(Settings()) as keys:
        return list(keys.find(100, 0)[0])


def test_nothing_but_the_secret_goes_to_the_output_that_a_script_reads() -> None:
    done = run("create", "alice")
    assert (done.exit_code, len(done.stdout.split())) == (0, 1)
    assert done.stdout.startswith("tl_")
    assert "shown once" in done.stderr


def test_what_is_printed_opens_and_only_its_hash_is_kept(directory: Path) -> None:
    secret = run("create", "alice").stdout.strip()
    engine = connect(Settings())
    stored = DatabaseKeyStore(engine).get(secret.split("_")[1])
    engine.dispose()
    assert stored is not None
    assert matches(secret, stored.hash)
    everything = b"".join(path.read_bytes() for path in directory.iterdir() if path.is_file())
    assert secret.split("_", 2)[2].encode() not in everything


def test_a_key_is_made_as_asked() -> None:
    done = run("create", "alice", "--project", "bridge", "--scopes", "read, metrics", "--expires", "90d")
    (key,) = kept()
    assert (done.exit_code, key.project, key.scopes) == (0, "bridge", {Scope.READ, Scope.METRICS})
    assert key.expires is not None
    assert (key.expires - key.created).days == 90


def test_a_date_ends_a_key_in_utc() -> None:
    run("create", "alice", "--expires", "2090-12-31")
    (key,) = kept()
    assert key.expires is not None
    assert key.expires.isoformat() == "2090-12-31T00:00:00+00:00"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["a b"], "name"),
        (["a", "--scopes", "root"], "scopes"),
        (["a", "--scopes", ","], "scopes"),
        (["a", "--project", ""], "project"),
        (["a", "--expires", "soon"], "expires"),
        (["a", "--expires", "2001-01-01"], "expires"),
    ],
)
def test_what_cannot_be_is_named_and_no_key_is_made(arguments: list[str], named: str) -> None:
    done = run("create", *arguments)
    assert (done.exit_code, done.stdout) == (2, "")
    assert named in done.stderr
    assert kept() == []


def test_a_name_is_taken_until_its_key_is_revoked() -> None:
    first, second = run("create", "alice"), run("create", "alice")
    revoked, third = run("revoke", "alice"), run("create", "alice")
    assert [done.exit_code for done in (first, second, revoked, third)] == [0, 2, 0, 0]


def test_a_key_is_revoked_by_its_id() -> None:
    run("create", "alice")
    (key,) = kept()
    assert run("revoke", key.id).exit_code == 0
    assert kept()[0].revoked is not None


def test_an_unknown_key_is_not_revoked() -> None:
    done = run("revoke", "nobody")
    assert (done.exit_code, "nobody" in done.stderr) == (2, True)


def test_keys_are_listed_without_their_secrets() -> None:
    secret = run("create", "alice", "--project", "default").stdout.strip()
    listed = run("list").stdout
    assert [word for word in ("alice", "default", "read,write", "never", "valid") if word not in listed] == []
    assert secret.split("_", 2)[2] not in listed


def test_an_empty_list_says_how_to_begin() -> None:
    assert "tieline keys create" in run("list").stdout


def test_a_database_that_cannot_be_used_is_a_fault_of_the_service(directory: Path) -> None:
    (directory / "tieline.sqlite").write_bytes(b"no database" * 100)
    assert run("list").exit_code == 3
