"""Secrets of subscribers are kept encrypted, for one project, with a key that is not in the database."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.adapters.database.callbacks import DatabaseCallbacks, seal_old_secrets
from service.adapters.database.jobs import DatabaseJobStore, migrate
from service.adapters.database.tables import connect, jobs
from service.errors import StorageError
from service.ports import CallbackEvent, Job, JobStatus, Subscription
from service.settings import Settings
from service.use_cases.access.sealed_secrets import KEY_FILE, is_sealed, seal_of

SECRET = "a secret of the subscriber"  # noqa: S105
OPERATORS = "the operator's secret of callbacks"
NOW = datetime(2026, 1, 2, tzinfo=UTC)
SUBSCRIPTION = Subscription({CallbackEvent.SUCCESS: "https://receiver.example/done"}, SECRET, "http://base")


def settings_in(folder: Path, **more: str) -> Settings:
    return Settings(data_dir=folder, **{"database_url": "", "callback_secret": "", **more})


@pytest.fixture
def engine(tmp_path: Path) -> sa.Engine:
    settings = settings_in(tmp_path)
    migrate(settings)
    return connect(settings)


@pytest.mark.parametrize("operators", ["", OPERATORS])
def test_what_is_kept_tells_nothing_and_is_opened_again(tmp_path: Path, operators: str) -> None:
    seal = seal_of(settings_in(tmp_path, callback_secret=operators))
    assert seal is not None
    kept = [seal.sealed(SECRET, "office"), seal.sealed(SECRET, "office")]
    assert kept[0] != kept[1]
    assert all(is_sealed(each) and SECRET not in each for each in kept)
    assert [seal.opened(each, "office") for each in kept] == [SECRET, SECRET]


def test_another_process_of_the_service_opens_it_and_a_copy_elsewhere_does_not(tmp_path: Path) -> None:
    here, elsewhere = tmp_path / "here", tmp_path / "elsewhere"
    for folder in (here, elsewhere):
        folder.mkdir()
    kept = sealed_in(here)
    again, other = seal_of(settings_in(here)), seal_of(settings_in(elsewhere))
    assert again is not None
    assert other is not None
    assert again.opened(kept, "office") == SECRET
    with pytest.raises(StorageError, match="another TIELINE_CALLBACK_SECRET"):
        other.opened(kept, "office")


def sealed_in(folder: Path, **more: str) -> str:
    seal = seal_of(settings_in(folder, **more))
    assert seal is not None
    return seal.sealed(SECRET, "office")


def test_for_another_project_it_is_not_opened(tmp_path: Path) -> None:
    seal = seal_of(settings_in(tmp_path))
    assert seal is not None
    with pytest.raises(StorageError):
        seal.opened(seal.sealed(SECRET, "office"), "stranger")


def test_an_operator_who_sets_a_secret_later_loses_none(tmp_path: Path) -> None:
    kept = sealed_in(tmp_path)
    later = seal_of(settings_in(tmp_path, callback_secret=OPERATORS))
    assert later is not None
    assert later.opened(kept, "office") == SECRET


def test_only_the_user_of_the_service_may_read_the_key(tmp_path: Path) -> None:
    sealed_in(tmp_path)
    assert (tmp_path / KEY_FILE).stat().st_mode & 0o777 == 0o600


def test_machines_that_share_a_database_keep_no_secrets_without_a_key_that_all_have(tmp_path: Path) -> None:
    settings = settings_in(tmp_path, database_url="postgresql://tieline:password@nowhere/x")
    assert seal_of(settings) is None


def stored(engine: sa.Engine) -> dict[str, str]:
    with engine.begin() as connection:
        rows = connection.execute(sa.select(jobs.c.id, jobs.c.subscriber))
        return {name: json.loads(json.dumps(subscriber))["secret"] for name, subscriber in rows}


def with_jobs(engine: sa.Engine) -> DatabaseJobStore:
    store = DatabaseJobStore(engine)
    for name in ("waiting", "told"):
        job = Job(name, "register", {}, JobStatus.ACCEPTED, NOW, subscriber=SUBSCRIPTION.to_json(), owner="office")
        store.create_and_enqueue(job)
    store.start("told", NOW)
    assert store.succeed("told", NOW)
    return store


def test_secrets_of_older_versions_are_encrypted_at_the_start(tmp_path: Path, engine: sa.Engine) -> None:
    with_jobs(engine)
    assert stored(engine)["waiting"] == SECRET
    seal = seal_of(settings_in(tmp_path))
    assert seal is not None
    for _ in range(2):
        seal_old_secrets(engine, seal)
        kept = stored(engine)
        assert {name: seal.opened(each, "office") for name, each in kept.items()} == dict.fromkeys(kept, SECRET)


def test_without_a_key_old_secrets_are_forgotten(engine: sa.Engine) -> None:
    with_jobs(engine)
    seal_old_secrets(engine, None)
    assert stored(engine) == {"waiting": "", "told": ""}


def test_when_all_is_told_the_secret_is_forgotten(tmp_path: Path, engine: sa.Engine) -> None:
    with_jobs(engine)
    seal_old_secrets(engine, seal_of(settings_in(tmp_path)))
    callbacks = DatabaseCallbacks(engine)
    (claimed,) = callbacks.claim("worker", 4, 60.0, [])
    callbacks.settle(claimed)
    kept = stored(engine)
    assert (kept["told"], is_sealed(kept["waiting"]), bool(kept["waiting"])) == ("", True, True)
