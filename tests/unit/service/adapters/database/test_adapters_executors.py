"""Heartbeats and leases: who lives, and who may act for the dead."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import sqlalchemy as sa

from service.adapters.database.executors import DEAD_AFTER_S, DatabaseExecutors
from service.adapters.database.jobs import migrate
from service.adapters.database.tables import connect, executors
from service.settings import Settings
from tests.servers.databases import NewDatabase


@pytest.fixture
def engine(tmp_path: Path, new_database: NewDatabase) -> Iterator[sa.Engine]:
    settings = Settings(data_dir=tmp_path, database_url=new_database())
    migrate(settings)
    engine = connect(settings)
    yield engine
    engine.dispose()


def change(engine: sa.Engine, executor_id: str, **values: object) -> None:
    with engine.begin() as connection:
        connection.execute(sa.update(executors).where(executors.c.id == executor_id).values(**values))


def executors_entered(engine: sa.Engine) -> list[str]:
    with engine.begin() as connection:
        return list(connection.execute(sa.select(executors.c.id)).scalars())


def test_a_worker_lives_from_its_entry_to_its_removal(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    registry.register("a")
    entered = list(registry.live())
    registry.remove("a")
    assert (entered, list(registry.live())) == (["a"], [])


def test_a_worker_whose_heart_has_stopped_is_buried_and_told_so(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    registry.register("a")
    change(engine, "a", heartbeat=executors.c.heartbeat - DEAD_AFTER_S - 1)
    before = list(registry.live())
    registry.bury_dead("b")
    assert (before, registry.beat("a"), executors_entered(engine)) == ([], False, [])


def test_a_worker_without_process_is_buried_without_waiting(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    registry.register("a")
    change(engine, "a", process_started=executors.c.process_started - 100)  # the number now belongs to another process
    registry.bury_dead("b")
    assert executors_entered(engine) == []


def test_a_worker_of_another_machine_is_judged_by_its_heart_only(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    registry.register("a")
    change(engine, "a", host="elsewhere", pid=os.getpid() + 1, process_started=0.0)
    registry.bury_dead("b")
    assert executors_entered(engine) == ["a"]


def test_a_lease_has_one_holder_until_it_is_gone(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    for each in ("a", "b"):
        registry.register(each)
    taken = [registry.lease("reaper", each, 60.0) for each in ("a", "b", "a")]
    registry.remove("a")
    assert (taken, registry.lease("reaper", "b", 60.0)) == ([True, False, True], True)


def test_a_lease_ends(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    for each in ("a", "b"):
        registry.register(each)
    registry.lease("reaper", "a", -1.0)
    assert registry.lease("reaper", "b", 60.0)


def test_a_lease_whose_holder_has_no_process_any_more_is_free_at_once(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    for each in ("a", "b"):
        registry.register(each)
    registry.lease("reaper", "a", 60.0)
    change(engine, "a", process_started=executors.c.process_started - 100)
    assert registry.lease("reaper", "b", 60.0)


def test_of_a_dead_worker_it_is_known_whether_its_launcher_died_too(engine: sa.Engine) -> None:
    registry = DatabaseExecutors(engine, several=True)
    for each in ("alone", "together"):
        registry.register(each, os.getpid())
    change(engine, "together", launcher_started=executors.c.launcher_started - 100)
    for each in ("alone", "together"):
        change(engine, each, process_started=executors.c.process_started - 100)
    dead = {each.id: each.whole_service for each in registry.bury_dead("b")}
    assert dead == {"alone": False, "together": True}


def test_of_an_embedded_database_all_other_workers_are_gone_and_no_heart_has_to_beat(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    migrate(settings)
    engine = connect(settings)
    registry = DatabaseExecutors(engine)
    for each in ("before", "now", "after a restart of the machine"):
        registry.register(each, os.getpid())
    change(engine, "after a restart of the machine", host="another boot")
    change(engine, "now", heartbeat=0.0)
    change(engine, "before", process_started=executors.c.process_started - 100)
    live = list(registry.live())
    dead = {each.id: each.whole_service for each in registry.bury_dead("now")}
    engine.dispose()
    assert "now" in live
    assert "before" not in live
    assert dead == {"before": False, "after a restart of the machine": True}
